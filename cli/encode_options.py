"""Options of `fecosplat encode` and `fecosplat batch encode`: which views are encoded, and how."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import OptionError
from fecocodec.sender.lambda_search import AtLeastNewPsnr, AtLeastPsnr, AtMostKib, Target

from .options import (
    METADATA,
    device_option,
    lambda_option,
    metadata_options,
    model_option,
    overwrite_option,
    parse_checks,
    parse_guides,
    parse_selection,
    parse_size,
    threads_option,
    with_options,
)
from .output import in_options

_DEPTH = click.FloatRange(min=0, min_open=True)
_ESTIMATED = "the scene, in scene units.  [default: estimated]"
_POSITIVE = click.FloatRange(min=0.0, min_open=True)
_TARGETS: dict[str, tuple[Callable[[float], Target], str, str]] = {
    "target_kib": (AtMostKib, "KIB", "the best quality in a file of at most this many KiB."),
    "target_psnr": (AtLeastPsnr, "DB", "the smallest file with at least this PSNR of the decoded views."),
    "target_new_psnr": (AtLeastNewPsnr, "DB", "the smallest file with at least this PSNR of new views, by --checks."),
}


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


encoding_options = with_options(
    lambda_option("Rate-distortion trade-off, 1e-5 to 1e-2. A smaller value gives better quality and a larger file."),
    *(
        click.option(_option(name), type=_POSITIVE, metavar=unit, help=f"Choose lambda automatically: {found}")
        for name, (_, unit, found) in _TARGETS.items()
    ),
    click.option(
        "--views",
        callback=parse_selection,
        metavar="WHICH",
        help="Photographs to code: how many (4), spread over the scene (beside each other if nothing guides); numbers "
        "(0,5; with a comma for one: 7,) or file names (a.jpg,b.jpg; a comma in a name is \\,); all; or auto for as "
        "many as it needs, at most 16.  [default: every photograph of up to four; else auto]",
    ),
    click.option(
        "--guides",
        callback=parse_guides,
        metavar="WHICH",
        help="Photographs that are not coded, but teach the encoder: at most how many (8), numbers or file names as "
        "for --views, none, or auto for up to 24 of the others.  [default: auto]",
    ),
    click.option(
        "--checks",
        "num_checks",
        callback=parse_checks,
        metavar="NUMBER",
        help="Number of photographs that are left out to measure new views, or none.  [default: one in ten, from six "
        "photographs on]",
    ),
    click.option("--size", callback=parse_size, metavar="WxH", help="Centre-crop and resize to WIDTHxHEIGHT pixels."),
    *(
        click.option(f"--{name}", type=_DEPTH, metavar="DEPTH", help=f"{which} depth of {_ESTIMATED}")
        for name, which in (("near", "Nearest"), ("far", "Farthest"))
    ),
    click.option(
        "--background",
        type=click.Choice(["white", "black"]),
        help="Composite transparent photographs on this colour.  [default: transparent regions decode to no Gaussians]",
    ),
    click.option(
        "--masks",
        type=click.Choice(["leave-out", "cut-out", "unused"]),
        default="leave-out",
        help="What becomes of pixels that are black in a mask (mask_path of a transforms.json, or a folder masks): "
        "leave-out makes the encoder ignore them, cut-out makes them transparent.",
    ),
    click.option("--stages", type=click.IntRange(1, 2), default=2, help="Number of stages to encode."),
    click.option(
        "--effort",
        type=click.Choice(["fast", "default", "best"]),
        default="default",
        help="Time spent on the file. fast takes a quarter of the time of default and three times the bytes at "
        "equal quality; best takes three to four times as long and comes closer to the photographs.",
    ),
    click.option(
        "--sharpness",
        type=click.FloatRange(-1.0, 1.0),
        default=0.0,
        help="From -1 (smoothest pictures, smallest file) to 1 (sharpest pictures, largest file).",
    ),
    click.option(
        "--strict",
        "is_strict",
        is_flag=True,
        help="Make every warning an error: the exit code is then 1, and no file is written.",
    ),
    metadata_options,
    model_option,
    device_option,
    threads_option,
    overwrite_option,
)


def options_of(values: dict[str, Any], **others: Any) -> EncodingOptions:
    """Return the library's options from the parsed ones. others: further options of the library.

    Raises InputError, or UsageError for options that exclude each other.
    """
    given = dict(values)
    metadata = {name: text for name in METADATA if (text := given.pop(name)) is not None}
    target = _target_of({name: given.pop(name) for name in _TARGETS})
    return EncodingOptions(target=target, num_stages=given.pop("stages"), metadata=metadata, **given, **others)


@contextmanager
def usage_errors() -> Iterator[None]:
    """Report options that the library refuses together as wrong usage."""
    try:
        yield
    except OptionError as error:
        raise click.UsageError(in_options(str(error))) from error


def _target_of(values: dict[str, float | None]) -> Target | None:
    """Return the target, or None to encode at --lambda. Raises UsageError for options that exclude each other."""
    targets: dict[str, Target] = {name: _TARGETS[name][0](value) for name, value in values.items() if value}
    if not targets:
        return None
    if len(targets) > 1:
        raise click.UsageError(f"{' and '.join(map(_option, targets))} exclude each other; give one of them.")
    context = click.get_current_context()
    if context.get_parameter_source("lmbda") is click.core.ParameterSource.COMMANDLINE:
        raise click.UsageError("A target chooses lambda; leave out --lambda or the target.")
    return next(iter(targets.values()))
