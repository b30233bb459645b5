"""`fecosplat decode`: decode a .fcs file to a file of 3D Gaussians."""

from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from fecocodec.atomic import require_other_file, require_writable, write_atomically
from fecocodec.container import read_stream_file
from fecocodec.errors import error_context
from fecocodec.splat_files.output_formats import ENDINGS, FORMATS, format_of

from .decode_options import decode_here, decoding_options, require_writer
from .options import FILE_PATH, STDIN, STREAM_PATH, json_option
from .output import print_json, say, warn, write_stdout
from .paths import STDOUT, require_ending, require_model, require_stream
from .progress import progress_bar

if TYPE_CHECKING:
    from fecocodec import Decoded

PARTLY_DECODED = 3  # exit code
DECODED = {1: "only stage 1", 2: "but both stages"}


@click.command(
    "decode",
    short_help="Decode a .fcs file to 3D Gaussians, or to a page that shows them.",
    epilog="""\b
Examples:
  fecosplat decode scene.fcs
  fecosplat decode scene.fcs -o scene.sog --frame first-camera
  fecosplat decode scene.fcs -o scene.ply --save-cameras cameras.json
  fecosplat decode scene.fcs -o preview.ply --stages 1
  fecosplat decode damaged.fcs -o rescued.ply --partial""",
)
@click.argument("stream", metavar="FILE.fcs", type=STREAM_PATH)
@click.option(
    "-o",
    "--output",
    type=FILE_PATH,
    help=f"Output file: {', '.join(f'{of.ending} ({of.title})' for of in FORMATS)}; - writes a .ply file to standard "
    "output.  [default: FILE.ply, beside FILE.fcs]",
)
@click.option(
    "--save-cameras",
    "cameras_file",
    type=FILE_PATH,
    metavar="FILE.json",
    help="Write the coded cameras, in the frame of the input cameras unless --frame is given, in the layout of "
    "nerfstudio (transforms.json), or of the 3DGS reference if the file is called cameras.json.",
)
@click.option(
    "--partial",
    is_flag=True,
    help=f"Decode the intact stages of a damaged file. The exit code is {PARTLY_DECODED} if any part of it is damaged.",
)
@decoding_options
@json_option
def command(
    stream: Path,
    output: Path | None,
    cameras_file: Path | None,
    partial: bool,
    decoding: dict[str, Any],
    writing: dict[str, Any],
    overwrite: bool,
    as_json: bool,
) -> int:
    """Decode FILE.fcs (- for standard input) to 3D Gaussians, in the unit of length of the input cameras.

    The ending of the output selects the format. docs/output_formats.md says which programs open which.
    """
    if partial and decoding["stages"] != "all":
        raise click.UsageError("--partial decodes all intact stages; leave --stages out.")
    start = perf_counter()
    if output is None and stream == STDIN:
        raise click.UsageError("Give -o, the output file.")
    require_stream(stream)
    output = output or stream.with_suffix(".ply")
    if output == STDOUT and as_json:
        raise click.UsageError("-o - writes the Gaussians to standard output; leave --json out.")
    if output != STDOUT:
        require_writable(output, overwrite=overwrite)
        require_other_file(output, stream)
        require_ending(output, ENDINGS)
        require_writer(output)
    if cameras_file is not None:
        require_writable(cameras_file, overwrite=overwrite)
        require_other_file(cameras_file, stream)
        require_ending(cameras_file, (".json",))
    require_model(decoding["model"])
    data = read_stream_file(stream)
    with error_context(stream), progress_bar() as on_progress:
        options = {**decoding, "stages": "intact"} if partial else decoding
        decoded = decode_here(data, on_progress=on_progress, **options)
    _write(decoded, output, cameras_file, writing, overwrite=overwrite)
    seconds, damage = round(perf_counter() - start, 3), decoded.damage
    if as_json:
        fields = {"gaussians": decoded.gaussians.count, "stages": decoded.stages, "damage": damage}
        print_json({"output": str(output), **fields, "seconds": seconds})
    else:
        say(f"{output}: {decoded.gaussians.count} Gaussians in {seconds:.2f} s")
    if damage is None:
        return 0
    warn(f"fecosplat: {stream}: damaged, {DECODED[decoded.stages]} could be decoded: {damage}")
    return PARTLY_DECODED


def _write(
    decoded: "Decoded", output: Path, cameras_file: Path | None, writing: dict[str, Any], *, overwrite: bool
) -> None:
    """Write the Gaussians, and the cameras if their file is given; neither if one of them cannot be written."""
    from fecocodec.splat_files.camera_json import write_camera_json
    from fecocodec.splat_files.gaussian_files import decoded_file

    place = Path("standard output") if output == STDOUT else output
    data, cameras, note = decoded_file(decoded, place, **writing)
    if note is not None:
        say(f"note: {place}: {note}")
    if cameras_file is not None and writing["frame"] is None and (frame := format_of(place).frame) != "input":
        say(
            f"note: the Gaussians of {output} have the frame {frame}, and the cameras of {cameras_file} the frame "
            f"input; --frame {frame} or --frame input writes both in one."
        )
    with nullcontext() if output == STDOUT else write_atomically(output, overwrite=overwrite) as temporary:
        if temporary is not None:
            temporary.write_bytes(data)
        if cameras_file is not None:
            names = [f"{view:02d}.png" for view in range(len(cameras.extrinsics))]  # as `render` names its images
            write_camera_json(cameras_file, cameras, names, overwrite=overwrite)
    if output == STDOUT:
        write_stdout(data)
