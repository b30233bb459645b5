"""Options of `fecosplat decode` and `fecosplat batch decode`: what is decoded, and how it is written."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from fecocodec.limits import MAX_SH_DEGREE
from fecocodec.splat_files.output_formats import FORMATS, PLY, RUB, Frame, OutputFormat

from .options import (
    device_option,
    max_pixels_option,
    model_option,
    num_threads,
    overwrite_option,
    threads_option,
    with_options,
)

if TYPE_CHECKING:
    from fecocodec import Decoded


def _endings(is_meant: Callable[[OutputFormat], bool]) -> str:
    return ", ".join(of.ending for of in FORMATS if is_meant(of))


_OF_DECODING = ("stages", "has_background", "is_merged", "model", "max_pixels", "device")
_add_options = with_options(
    click.option(
        "--frame",
        type=click.Choice(get_args(Frame)),
        help="Coordinate frame of the output and of saved cameras: that of the input cameras, or the first camera at "
        f"the origin, looking along +Z with +Y down, or along -Z with +Y up ({_endings(lambda of: of.axes == RUB)}). "
        "upright: the same, level, with the vertical estimated from the cameras.  [default: upright for "
        f"{_endings(lambda of: of.frame == 'upright')}, else input]",
    ),
    click.option(
        "--spz-version",
        type=click.Choice(["3", "4"]),
        default="3",
        help="Version of .spz files. Few viewers read 4.",
    ),
    click.option(
        "--stages",
        type=click.IntRange(1, 2),
        help="Number of stages to decode. 1 gives a preview, and also works for a file that was truncated after stage "
        "1.  [default: all]",
    ),
    click.option(
        "--merge/--no-merge",
        "is_merged",
        default=True,
        help="Merge neighbouring Gaussians of similar colour: a quarter fewer Gaussians, half on blank walls, for a "
        "loss of a few hundredths of a dB. Without it, each stands for 2x2 pixels of its view.",
    ),
    click.option(
        "--sh-degree",
        type=click.IntRange(0, 3),
        help="Degree of the spherical harmonics in the file. 0: constant colours; above the model's (1, or 2 with the "
        f"paper's method): zeros for loaders that expect this degree.  [default: {PLY.sh_degree} for .ply, else the "
        "model's]",
    ),
    click.option(
        "--background-layer/--no-background-layer",
        "has_background",
        default=True,
        help="Fill regions that no photograph shows with blurred Gaussians. Without them these regions are black.",
    ),
    model_option,
    max_pixels_option,
    device_option,
    threads_option,
    overwrite_option,
)


def decoding_options(function: Callable[..., int]) -> Callable[..., int]:
    """Add the options, from --frame to --overwrite.

    Those of `fecocodec.decode` are passed as one argument, `decoding`, and those of the file that is written as
    `writing`: both are keyword arguments of the library.
    """

    @wraps(function)
    def with_groups(**values: Any) -> int:
        decoding = {name: values.pop(name) for name in _OF_DECODING}
        decoding["stages"] = decoding["stages"] or "all"
        sh_degree = values.pop("sh_degree")
        decoding["sh_degree"] = MAX_SH_DEGREE if sh_degree is None else min(sh_degree, MAX_SH_DEGREE)
        spz_version = int(values.pop("spz_version"))
        writing = {"frame": values.pop("frame"), "sh_degree": sh_degree, "spz_version": spz_version}
        return function(decoding=decoding, writing=writing, **values)

    return _add_options(with_groups)


def decode_here(data: bytes, **options: Any) -> "Decoded":
    """Run `fecocodec.decode` with the threads that --threads or the environment allows this process."""
    from fecocodec import decode

    return decode(data, num_threads=num_threads(0), **options)


def require_writer(output: Path) -> None:
    """Raise OutputError if the format of a file needs a library or a page that is missing: nothing is decoded in vain.

    .html files need the viewer's page, which is built.
    """
    from fecocodec.splat_files.gaussian_files import writer_of

    writer = writer_of(output)
    if output.suffix.lower() == ".html":
        writer.scene_page()
