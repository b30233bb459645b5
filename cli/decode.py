"""`fecosplat decode`: a .fcs file in, Gaussians as a PLY out."""

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import click

from fecocodec.formats.atomic import require_other_file, require_writable

from .naming import naming
from .options import FILE_PATH, device_option, json_option, model_option, overwrite_option, threads_option
from .output import print_json, say, write_stdout
from .paths import STDOUT, require_ending
from .progress import OnProgress, progress_bar
from .stream import read_bytes

if TYPE_CHECKING:
    from fecocodec.receiver.partial import IntactDecoding

PARTLY_DECODED = 3  # exit code
STAGES = {1: "stage 1 could be", 2: "the two stages could be"}  # the rest is metadata, or what to keep


@click.command(
    "decode",
    short_help="Turn a .fcs file into Gaussians (.ply).",
    epilog="""\b
Examples:
  fecosplat decode scene.fcs -o scene.ply
  fecosplat decode scene.fcs -o preview.ply --stages 1
  fecosplat decode damaged.fcs -o rescued.ply --partial""",
)
@click.argument("stream", metavar="FILE.fcs", type=FILE_PATH)
@click.option(
    "-o", "--output", required=True, type=FILE_PATH, help="Where to write the Gaussians (3DGS .ply); - is stdout."
)
@click.option(
    "--stages",
    type=click.IntRange(1, 2),
    help="Decode only the first stage: a preview, also of a file that was cut after it.  [default: all]",
)
@click.option(
    "--partial",
    is_flag=True,
    help=f"Of a damaged file, decode the stages that are intact; exit code {PARTLY_DECODED} says that some were not.",
)
@click.option(
    "--prune",
    is_flag=True,
    help="Leave out Gaussians that pictures near the cameras need not have, and let the others stand for them (takes "
    "seconds).",
)
@click.option(
    "--sh-degree",
    type=click.IntRange(0, 1),
    default=1,
    show_default=True,
    help="1: colours depend on where they are seen from. 0: they do not, and the .ply is a third smaller.",
)
@model_option
@device_option
@threads_option
@overwrite_option
@json_option
def command(
    stream: Path,
    output: Path,
    stages: int | None,
    partial: bool,
    prune: bool,
    sh_degree: int,
    model: Path | None,
    device: str,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Decode FILE.fcs to 3D Gaussians in the frame and unit of length of the photographs' cameras.

    The result is a .ply with the usual 3DGS properties, which viewers such as SuperSplat open.
    """
    if partial and stages is not None:
        raise click.UsageError("--partial finds out by itself how many stages are intact; leave --stages out.")
    start = perf_counter()
    if output == STDOUT and as_json:
        raise click.UsageError("-o - writes the Gaussians to standard output; leave --json out.")
    if output != STDOUT:
        require_writable(output, overwrite=overwrite)
        require_other_file(output, stream)
        require_ending(output, (".ply",))
    data = read_bytes(stream)

    from fecocodec.formats.ply import ply_bytes, write_ply

    from .device import require_device

    require_device(device)
    with naming(stream), progress_bar() as on_progress:
        decoded = _decode(data, stages, partial, sh_degree, model, device, on_progress)
        if prune:
            decoded = _pruned(decoded, data)
    if output == STDOUT:
        write_stdout(ply_bytes(decoded.gaussians, "standard output"))
    else:
        write_ply(output, decoded.gaussians, overwrite=overwrite)
    seconds = round(perf_counter() - start, 3)
    count, damage = decoded.gaussians.count, decoded.damage
    if as_json:
        fields = {"output": str(output), "gaussians": count, "stages": decoded.num_stages, "damage": damage}
        print_json({**fields, "seconds": seconds})
    else:
        say(f"{output}: {count} Gaussians in {seconds:.2f} s")
    if damage is None:
        return 0
    say(f"fecosplat: {stream}: damaged, only {STAGES[decoded.num_stages]} decoded: {damage}")
    return PARTLY_DECODED


def _pruned(decoded: "IntactDecoding", data: bytes) -> "IntactDecoding":
    from fecocodec.receiver.decode import read_cameras
    from fecocodec.rendering.pruning import pruned

    return replace(decoded, gaussians=pruned(decoded.gaussians, *read_cameras(data)))


def _decode(
    data: bytes,
    stages: int | None,
    partial: bool,
    sh_degree: int,
    model: Path | None,
    device: str,
    on_progress: OnProgress,
) -> "IntactDecoding":
    from fecocodec import decode, decode_intact
    from fecocodec.container import read_stream
    from fecocodec.receiver.partial import IntactDecoding

    from .weights import of_receiver

    common = {"sh_degree": sh_degree, "device": device, "on_progress": on_progress, **of_receiver(model)}
    if partial:
        return decode_intact(data, **common)
    gaussians = decode(data, num_stages=stages, **common)
    return IntactDecoding(gaussians, read_stream(data).header.num_stages if stages is None else stages, None)
