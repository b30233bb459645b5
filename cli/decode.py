"""`fecosplat decode`: decode a .fcs file to a file of 3D Gaussians."""

from pathlib import Path
from time import perf_counter

import click

from fecocodec.atomic import require_other_file, require_writable
from fecocodec.container import Stages, check_pixels, read_stages, read_stream_file
from fecocodec.errors import error_context
from fecocodec.model_files import find_receiver

from .decode_options import decoding_options
from .options import FILE_PATH, json_option, stream_path
from .output import print_json, say, warn
from .paths import STDOUT, require_ending, require_model
from .progress import progress_bar
from .receivers import DecodeOptions, decode_stream
from .scene_output import GAUSSIAN_ENDINGS, Frame, require_page, write_scene
from .terminal import printable

PARTLY_DECODED = 3  # exit code
DECODED = {1: "only stage 1", 2: "but both stages"}


@click.command(
    "decode",
    short_help="Decode a .fcs file to 3D Gaussians (.ply, .spz, .sog, .glb) or a page (.html).",
    epilog="""\b
Examples:
  fecosplat decode scene.fcs -o scene.ply
  fecosplat decode scene.fcs -o scene.sog --frame first-camera
  fecosplat decode scene.fcs -o scene.ply --save-cameras cameras.json
  fecosplat decode scene.fcs -o preview.ply --stages 1
  fecosplat decode damaged.fcs -o rescued.ply --partial""",
)
@click.argument("stream", metavar="FILE.fcs", type=stream_path)
@click.option(
    "-o",
    "--output",
    required=True,
    type=FILE_PATH,
    help="Output file: .ply (3DGS), .compressed.ply, .spz, .sog, .glb (KHR_gaussian_splatting), or .html (a page "
    "that shows the scene; needs `make web` once); - writes a .ply to standard output.",
)
@click.option(
    "--save-cameras",
    "cameras_file",
    type=FILE_PATH,
    metavar="FILE.json",
    help="Write the coded cameras in the frame of the .ply file, in the layout of nerfstudio (transforms.json), or of "
    "the 3DGS reference if the file is called cameras.json.",
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
    output: Path,
    cameras_file: Path | None,
    frame: Frame,
    spz_version: str,
    stages: int | None,
    partial: bool,
    merge: bool,
    sh_degree: int,
    has_background: bool,
    model: Path | None,
    max_pixels: int,
    device: str,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Decode FILE.fcs (- for standard input) to 3D Gaussians, in the unit of length of the input cameras.

    The ending of the output selects the format. Viewers such as SuperSplat open all of them.
    """
    if partial and stages is not None:
        raise click.UsageError("--partial decodes all intact stages; leave --stages out.")
    start = perf_counter()
    if output == STDOUT and as_json:
        raise click.UsageError("-o - writes the Gaussians to standard output; leave --json out.")
    if output != STDOUT:
        require_writable(output, overwrite=overwrite)
        require_other_file(output, stream)
        require_ending(output, GAUSSIAN_ENDINGS)
        require_page(output.suffix)
    if cameras_file is not None:
        require_writable(cameras_file, overwrite=overwrite)
        require_other_file(cameras_file, stream)
        require_ending(cameras_file, (".json",))
    require_model(model)
    data = read_stream_file(stream)
    wanted: Stages = "intact" if partial else stages or "all"
    with error_context(stream):  # before any large library is loaded
        header = read_stages(data, wanted).stream.header
        check_pixels(header, max_pixels)
        find_receiver(header.model_id, model)

    options = DecodeOptions(wanted, sh_degree, has_background, merge, device, model, max_pixels)
    with error_context(stream), progress_bar() as on_progress:
        decoded = decode_stream(data, options, on_progress)
    write_scene(
        decoded,
        output,
        cameras_file,
        frame=frame,
        spz_version=3 if spz_version == "3" else 4,
        overwrite=overwrite,
    )
    seconds = round(perf_counter() - start, 3)
    damage = decoded.damage
    if as_json:
        fields = {
            "output": str(output),
            "gaussians": decoded.gaussians.count,
            "stages": decoded.stages,
            "damage": damage,
        }
        print_json({**fields, "seconds": seconds})
    else:
        say(f"{output}: {decoded.gaussians.count} Gaussians in {seconds:.2f} s")
    if damage is None:
        return 0
    warn(printable(f"fecosplat: {stream}: damaged, {DECODED[decoded.stages]} could be decoded: {damage}"))
    return PARTLY_DECODED
