"""Rate-control options of `fecosplat encode`: a target file size or quality instead of a lambda."""

from collections.abc import Callable
from typing import TypeVar

import click

from fecocodec.sender.rate_targets import AtLeastNewPsnr, AtLeastPsnr, AtMostKib, Target

Function = TypeVar("Function", bound=Callable[..., object])


def rate_control_options(function: Function) -> Function:
    """Add --target-kib, --target-psnr and --target-new-psnr."""
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
        click.option(
            "--target-new-psnr",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="DB",
            help="Choose lambda automatically: the smallest file with at least this PSNR of new views, by --checks.",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def target_of(target_kib: float | None, target_psnr: float | None, target_new_psnr: float | None) -> Target | None:
    """Return the rate-control target, or None to encode at --lambda.

    Raises UsageError for options that exclude each other.
    """
    given = {
        "--target-kib": target_kib and AtMostKib(target_kib),
        "--target-psnr": target_psnr and AtLeastPsnr(target_psnr),
        "--target-new-psnr": target_new_psnr and AtLeastNewPsnr(target_new_psnr),
    }
    targets: dict[str, Target] = {name: target for name, target in given.items() if target}
    if not targets:
        return None
    if len(targets) > 1:
        raise click.UsageError(f"{' and '.join(targets)} exclude each other; give one of them.")
    context = click.get_current_context()
    if context.get_parameter_source("lmbda") is click.core.ParameterSource.COMMANDLINE:
        raise click.UsageError("A target chooses lambda; leave out --lambda or the target.")
    return next(iter(targets.values()))
