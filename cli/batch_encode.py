"""`fecosplat batch encode`: encode many scene folders to .fcs files."""

from pathlib import Path
from typing import Any

import click

from fecocodec.errors import some_of

from .batch_options import BatchOptions, batch_options, run_and_report
from .encode_options import encoding_options, options_of, usage_errors
from .options import FILE_PATH
from .output import say


@click.command(
    "encode",
    short_help="Encode many scene folders to .fcs files.",
    epilog="""\b
Examples:
  fecosplat batch encode scenes/ -o coded/
  fecosplat batch encode scenes/ -o coded/ --views 4 --size 448x256 --effort best
  fecosplat batch encode manifest.txt -o coded/ --scheduler tcp://host:8786
  fecosplat batch encode scenes/ -o coded/ --shard 3/16 --threads 1""",
)
@click.argument("source", metavar="ROOT|MANIFEST", type=FILE_PATH)
@batch_options
@click.option("--measure", "is_measured", is_flag=True, help="Decode each file, and record its PSNR in the .json file.")
@encoding_options
@usage_errors()
def command(source: Path, batch: BatchOptions, is_measured: bool, **values: Any) -> int:
    """Encode each scene folder in ROOT, or each that MANIFEST names, to OUTPUT/NAME.fcs.

    A manifest is a text file with one scene a line: a path, or a name, a tab and a path. Beside each file,
    NAME.fcs.json records its input and options; scenes whose record matches are skipped. A scene that fails does not
    stop the others; the exit code is then 1. Several processes need the `cluster` extra.
    """
    model = values.pop("model")
    model = None if model is None else str(model.absolute())
    options = options_of(values, model=model, is_measured=is_measured)

    from fecocodec.batch.scenes import scene_folders

    scenes = scene_folders(source, output=batch.output)

    from fecocodec.batch.encode_scene import EncodeScene, passed_over

    if files := passed_over(source):
        say(f"note: {source}: not encoded, because only folders are scenes: {some_of(files)}.")
    work = EncodeScene(options)
    if batch.scheduler is None:  # its workers may have other devices and files
        options.require_device()
        work.weights(source)
    return run_and_report(scenes, work, batch)
