"""Rate-control options of `fecosplat encode`: a target file size or quality instead of a lambda."""

from collections.abc import Callable
from typing import TypeVar

import click

from fecocodec.sender.lambda_search import AtLeastPsnr, AtMostKib, Target

Function = TypeVar("Function", bound=Callable[..., object])


def rate_control_options(function: Function) -> Function:
    """Add --target-kib and --target-psnr."""
    options = (
        click.option(
            "--target-kib",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="KIB",
            help="Choose lambda automatically: the best quality in a file of at most this many KiB.",
        ),
        click.option(
            "--target-psnr",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="DB",
            help="Choose lambda automatically: the smallest file with at least this PSNR of the decoded views.",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def target_of(target_kib: float | None, target_psnr: float | None) -> Target | None:
    """Return the rate-control target, or None to encode at --lambda.

    Raises UsageError for options that exclude each other.
    """
    if target_kib is None and target_psnr is None:
        return None
    if target_kib is not None and target_psnr is not None:
        raise click.UsageError("--target-kib and --target-psnr exclude each other; give one of them.")
    context = click.get_current_context()
    if context.get_parameter_source("lmbda") is click.core.ParameterSource.COMMANDLINE:
        raise click.UsageError("A target chooses lambda; leave out --lambda or the target.")
    if target_kib is not None:
        return AtMostKib(target_kib)
    assert target_psnr is not None
    return AtLeastPsnr(target_psnr)
