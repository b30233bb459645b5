"""Options that several commands share, and the reading of their values."""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from fecocodec.limits import DEFAULT_MAX_PIXELS

Function = TypeVar("Function", bound=Callable[..., object])


# A path; the library checks whether it can be read, and names the file in its message (exit code 1, not 2).
FILE_PATH = click.Path(readable=False, path_type=Path)


def parse_size(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """WIDTHxHEIGHT, as users of photographs write it, becomes the library's `(height, width)`."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", value)
    if match is None:
        raise click.BadParameter(f"{value!r} is not WIDTHxHEIGHT, such as 448x256.", ctx, param)
    return int(match[2]), int(match[1])


def overwrite_option(function: Function) -> Function:
    return click.option("--overwrite", is_flag=True, help="Replace the output if it exists.")(function)


def json_option(function: Function) -> Function:
    return click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")(function)


def model_option(function: Function) -> Function:
    return click.option("--model", type=FILE_PATH, metavar="FOLDER", help="The weights.  [default: those that ship]")(
        function
    )


def device_option(function: Function) -> Function:
    return click.option(
        "--device",
        default="cpu",
        show_default=True,
        metavar="NAME",
        callback=_parse_device,
        help="Where networks run: cpu, cuda, or cuda:N.",
    )(function)


def max_pixels_option(function: Function) -> Function:
    return click.option(
        "--max-pixels",
        type=click.IntRange(min=1),
        default=DEFAULT_MAX_PIXELS,
        show_default=True,
        metavar="NUMBER",
        help="Refuse a .fcs file whose views have more pixels in all; memory is proportional to it.",
    )(function)


def threads_option(function: Function) -> Function:
    return click.option(
        "--threads",
        type=click.IntRange(min=1),
        callback=_limit_threads,
        expose_value=False,
        is_eager=True,
        help="Processor threads to use at most.  [default: all cores]",
    )(function)


def _parse_device(ctx: click.Context, param: click.Parameter, value: str) -> str:
    if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", value):
        raise click.BadParameter(f"{value!r} is none of cpu, cuda, cuda:N.", ctx, param)
    return value


def _limit_threads(ctx: click.Context, param: click.Parameter, value: int | None) -> None:
    """Numeric libraries read these variables once, when they load; commands load them after parsing."""
    if value is None:
        return
    for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = str(value)
