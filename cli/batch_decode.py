"""`fecosplat batch decode`: decode many .fcs files to files of 3D Gaussians."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from fecocodec.splat_files.output_formats import ENDINGS, PLY

from .batch_options import BatchOptions, batch_options, run_and_report
from .decode_options import decode_here, decoding_options, require_writer
from .options import FILE_PATH


@click.command(
    "decode",
    short_help="Decode many .fcs files to files of 3D Gaussians.",
    epilog="""\b
Examples:
  fecosplat batch decode coded/ -o splats/
  fecosplat batch decode coded/ -o splats/ --format spz --no-merge
  fecosplat batch decode coded/ -o splats/ --shard 3/16 --threads 1""",
)
@click.argument("source", metavar="ROOT|MANIFEST", type=FILE_PATH)
@batch_options
@click.option(
    "--format",
    "file_format",
    type=click.Choice([ending.removeprefix(".") for ending in ENDINGS]),
    default=PLY.ending.removeprefix("."),
    help="Format of the output files.",
)
@decoding_options
def command(
    source: Path,
    batch: BatchOptions,
    file_format: str,
    decoding: dict[str, Any],
    writing: dict[str, Any],
) -> int:
    """Decode each .fcs file in ROOT, or each that MANIFEST names, to OUTPUT/NAME.ply or another format.

    The manifest, the .json file beside each output and the exit code are as for `fecosplat batch encode`.
    """
    require_writer(Path(f"NAME.{file_format}"))

    from fecocodec.batch.scenes import coded_scenes

    scenes = coded_scenes(source)

    from fecocodec.batch.decode_scene import DecodeScene

    model = decoding["model"]
    decoding["model"] = None if model is None else model.absolute()  # workers may run in another folder
    changing = tuple((name, decoding[name]) for name in ("stages", "has_background", "is_merged"))
    work = DecodeScene(f".{file_format}", partial(decode_here, **decoding), changing, **writing)
    return run_and_report(scenes, work, batch)
