"""Options of `fecosplat encode` that send no more than a scene needs, or aim at a size or a quality."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import click

if TYPE_CHECKING:
    from fecocodec.sender.adaptive import Goal

Function = TypeVar("Function", bound=Callable[..., object])


def adaptive_options(function: Function) -> Function:
    """Add --adaptive, --target-kib and --target-psnr."""
    options = (
        click.option(
            "--adaptive",
            is_flag=True,
            help="Smaller files for more time: sixteen steps of refinement, no second stage where it does not pay, no "
            "Gaussians that nobody would miss.",
        ),
        click.option(
            "--target-kib",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="KIB",
            help="Find the lambda of the best quality in a file of at most so many KiB; adaptive.",
        ),
        click.option(
            "--target-psnr",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="DB",
            help="Find the lambda of the smallest file whose decoded context views have this PSNR; adaptive.",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def goal_of(
    lmbda: float, adaptive: bool, target_kib: float | None, target_psnr: float | None, stages: int
) -> "Goal | None":
    """What to encode adaptively at; None: not adaptively. Raises UsageError for options that contradict each other."""
    if target_kib is None and target_psnr is None and not adaptive:
        return None

    from fecocodec import AtLambda, AtLeastPsnr, AtMostKib

    if target_kib is not None and target_psnr is not None:
        raise click.UsageError("Give --target-kib or --target-psnr, not both.")
    if stages == 1:
        raise click.UsageError("--stages 1 leaves nothing to decide; leave it out, or --adaptive and the targets.")
    context = click.get_current_context()
    is_lambda_given = context.get_parameter_source("lmbda") is click.core.ParameterSource.COMMANDLINE
    if is_lambda_given and (target_kib or target_psnr):
        raise click.UsageError("A target finds the lambda by itself; leave --lambda out.")
    if target_kib is not None:
        return AtMostKib(target_kib)
    return AtLambda(lmbda) if target_psnr is None else AtLeastPsnr(target_psnr)
