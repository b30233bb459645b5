"""`fecosplat batch decode`: decode many .fcs files to files of 3D Gaussians."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .batch_options import BatchOptions, batch_options
from .decode_options import decoding_options
from .options import FILE_PATH
from .receivers import DecodeOptions, decode_stream
from .scene_output import require_page

if TYPE_CHECKING:
    from fecocodec import Decoded
    from fecocodec.runtime.decode import DecodedScene

FORMATS = ("ply", "compressed.ply", "spz", "sog", "glb", "html")


@click.command(
    "decode",
    short_help="Decode many .fcs files to files of 3D Gaussians.",
    epilog="""\b
Examples:
  fecosplat batch decode coded/ -o splats/
  fecosplat batch decode coded/ -o splats/ --format spz --merge
  fecosplat batch decode coded/ -o splats/ --shard 3/16 --threads 1""",
)
@click.argument("source", metavar="ROOT|MANIFEST", type=FILE_PATH)
@batch_options
@click.option(
    "--format",
    "file_format",
    type=click.Choice(FORMATS),
    default="ply",
    show_default=True,
    help="Format of the output files.",
)
@decoding_options
def command(source: Path, batch: BatchOptions, file_format: str, **decoding: Any) -> int:
    """Decode each .fcs file in ROOT, or each that MANIFEST names, to OUTPUT/NAME.ply or another format.

    The manifest, the .json file beside each output and the exit code are as for `fecosplat batch encode`.
    """
    require_page(f".{file_format}")

    from fecocodec.batch.scenes import coded_scenes

    scenes = coded_scenes(source)

    from fecocodec.batch.decode_scene import DecodeScene

    from .batch_report import run_and_report

    changing = {name: decoding[name] for name in ("stages", "sh_degree", "has_background", "merge")}
    model = decoding["model"]
    receiver = DecodeOptions(
        decoding["stages"] or "all",
        decoding["sh_degree"],
        decoding["has_background"],
        decoding["merge"],
        decoding["device"],
        None if model is None else model.absolute(),
        decoding["max_pixels"],
    )
    work = DecodeScene(
        suffix=f".{file_format}",
        decode=partial(decode_for_batch, options=receiver),
        decode_options=tuple(changing.items()),
        frame=decoding["frame"],
        spz_version=3 if decoding["spz_version"] == "3" else 4,
    )
    return run_and_report(scenes, work, batch)


def decode_for_batch(data: bytes, options: DecodeOptions) -> "Decoded | DecodedScene":
    """Decode a stream without progress; a function of this module, so that it can be sent to other processes."""
    return decode_stream(data, options, lambda _step, _fraction: None)
