"""`fecosplat decode`: a .fcs file in, Gaussians as a PLY out."""

from pathlib import Path
from time import perf_counter

import click

from fecocodec.formats.atomic import require_writable

from .naming import naming
from .options import FILE_PATH, device_option, json_option, overwrite_option, threads_option
from .output import print_json, say
from .progress import progress_bar
from .stream import read_bytes


@click.command(
    "decode",
    short_help="Turn a .fcs file into Gaussians (.ply).",
    epilog="""\b
Examples:
  fecosplat decode scene.fcs -o scene.ply
  fecosplat decode scene.fcs -o preview.ply --stages 1""",
)
@click.argument("stream", metavar="FILE.fcs", type=FILE_PATH)
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Where to write the Gaussians (3DGS .ply).")
@click.option(
    "--stages",
    type=click.IntRange(1, 2),
    help="Decode only the first stage: a preview, also of a file that was cut after it.  [default: all]",
)
@device_option
@threads_option
@overwrite_option
@json_option
def command(stream: Path, output: Path, stages: int | None, device: str, overwrite: bool, as_json: bool) -> None:
    """Decode FILE.fcs to 3D Gaussians in the frame and unit of length of the photographs' cameras.

    The result is a .ply with the usual 3DGS properties, which viewers such as SuperSplat open.
    """
    start = perf_counter()
    require_writable(output, overwrite=overwrite)
    data = read_bytes(stream)

    from fecocodec import decode, write_ply

    from .device import require_device

    require_device(device)
    with naming(stream), progress_bar() as on_progress:
        gaussians = decode(data, num_stages=stages, device=device, on_progress=on_progress)
    write_ply(output, gaussians, overwrite=overwrite)
    seconds = round(perf_counter() - start, 3)
    if as_json:
        print_json({"output": str(output), "gaussians": gaussians.count, "seconds": seconds})
    else:
        say(f"{output}: {gaussians.count} Gaussians in {seconds:.2f} s")
