"""Options of `fecosplat decode` and `fecosplat batch decode`: what is decoded, and how it is written."""

import click

from .options import Function, device_option, max_pixels_option, model_option, overwrite_option, threads_option

_OPTIONS = (
    click.option(
        "--frame",
        type=click.Choice(["input", "first-camera"]),
        default="input",
        show_default=True,
        help="Coordinate frame of the output: that of the input cameras, or the first camera at the origin, looking "
        "along +Z with +Y down (.ply, .compressed.ply, .sog) or along -Z with +Y up (.spz, .glb).",
    ),
    click.option(
        "--spz-version",
        type=click.Choice(["3", "4"]),
        default="4",
        show_default=True,
        help="Version of .spz files. Older viewers read only 3.",
    ),
    click.option(
        "--stages",
        type=click.IntRange(1, 2),
        help="Number of stages to decode. 1 gives a preview, and also works for a file that was truncated after stage "
        "1.  [default: all]",
    ),
    click.option(
        "--merge",
        is_flag=True,
        help="Merge neighbouring Gaussians of similar colour on flat surfaces: about 20% fewer Gaussians for a loss of "
        "a few hundredths of a dB.",
    ),
    click.option(
        "--sh-degree",
        type=click.IntRange(0, 1),
        default=1,
        show_default=True,
        help="Degree of the spherical harmonics. 1: view-dependent colours. 0: constant colours, and a .ply that is a "
        "third smaller.",
    ),
    click.option(
        "--background-layer/--no-background-layer",
        "has_background",
        default=True,
        show_default=True,
        help="Fill regions that no photograph shows with blurred Gaussians. Without them these regions are black.",
    ),
)


def decoding_options(function: Function) -> Function:
    """Add the options, from --frame to --overwrite."""
    shared = (model_option, max_pixels_option, device_option, threads_option, overwrite_option)
    for decorator in reversed((*_OPTIONS, *shared)):
        function = decorator(function)
    return function
