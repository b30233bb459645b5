"""Options shared by several commands, and the parsing of their values."""

import datetime
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from fecocodec.captures.view_selection import LONGEST_NUMBER, All, Auto, Guides, Selection, Spread
from fecocodec.limits import DEFAULT_MAX_PIXELS

MAX_THREADS = 1024
STDIN = Path("/dev/stdin")
Function = TypeVar("Function", bound=Callable[..., object])


class _FilePath(click.Path):
    """A file or folder. The library checks it and names it in its message (exit code 1, not 2).

    An empty path is refused: it would mean the current folder, and mostly comes from an unset variable of a shell.
    """

    def __init__(self) -> None:
        super().__init__(readable=False, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the path is empty; name a file or folder, or . for the current folder.", param, ctx)
        return super().convert(value, param, ctx)


class _StreamPath(_FilePath):
    """A .fcs file to read; `-` is standard input. A type of click, so that shells complete names of files."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return STDIN if value == "-" else super().convert(value, param, ctx)


FILE_PATH, STREAM_PATH = _FilePath(), _StreamPath()


def parsed(parse: Callable[[str], Any]) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Return the callback of an option that parses its text, or each of several texts, unless it is left out.

    parse: raises ValueError with a message for the user.
    """

    def callback(ctx: click.Context, param: click.Parameter, value: Any) -> Any:
        if not value and not isinstance(value, str):
            return None
        try:
            return tuple(map(parse, value)) if isinstance(value, tuple) else parse(value)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from error

    return callback


@parsed
def parse_size(value: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT to `(height, width)` in pixels, the order that the library uses."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", value)
    if match is None:
        raise ValueError(f"{value!r} is not WIDTHxHEIGHT, such as 448x256.")
    return int(match[2]), int(match[1])


@parsed
def parse_shard(value: str) -> tuple[int, int]:
    """Parse I/N to (I, N), with 1 <= I <= N."""
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", value)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise ValueError(f"{value!r} is not I/N with I from 1 to N, such as 2/8.")
    return int(match[1]), int(match[2])


def with_options(*decorators: Callable[[Any], Any]) -> Callable[[Function], Function]:
    """Return the decorator that adds these options, in the order of `--help`."""

    def decorate(function: Function) -> Function:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


@parsed
def _parse_device(value: str) -> str:
    if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", value):
        raise ValueError(f"{value!r} is none of cpu, cuda, cuda:N.")
    return value


@parsed
def _parse_date(value: str) -> str:
    try:
        return datetime.date.fromisoformat(value).isoformat()
    except ValueError as error:
        raise ValueError(f"{value[:40]!r} is not a date like 2026-05-31.") from error


def _limit_threads(ctx: click.Context, param: click.Parameter, value: int | None) -> None:
    """Set the environment variables that numeric libraries read when they are imported, which is after parsing."""
    if value is None:
        return
    for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = str(value)


def num_threads(default: int) -> int:
    """Return the number of threads that --threads or the environment sets."""
    value = os.environ.get("OMP_NUM_THREADS", "")
    return int(value) if value.isdecimal() else default


def lambda_option(help_text: str) -> Callable[[Function], Function]:
    """Return the decorator that adds --lambda, passed as `lmbda`."""
    return click.option("--lambda", "lmbda", type=float, default=1e-3, metavar="NUMBER", help=help_text)


overwrite_option = click.option("--overwrite", is_flag=True, help="Replace the output if it exists.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")
model_option = click.option(
    "--model", type=FILE_PATH, metavar="FOLDER", help="Folder of the model weights.  [default: the shipped model]"
)
device_option = click.option(
    "--device",
    default="cpu",
    metavar="NAME",
    callback=_parse_device,  # only the form of the name, see `usable_device`
    help="Device that runs the networks: cpu, cuda or cuda:N.",
)
max_pixels_option = click.option(
    "--max-pixels",
    type=click.IntRange(min=1),
    default=DEFAULT_MAX_PIXELS,
    metavar="NUMBER",
    help="Reject a .fcs file whose views together have more pixels than this. Memory grows in proportion.",
)
threads_option = click.option(
    "--threads",
    type=click.IntRange(1, MAX_THREADS),
    callback=_limit_threads,
    expose_value=False,
    is_eager=True,
    help="Maximum number of CPU threads.  [default: all cores]",
)
METADATA = ("title", "author", "licence", "date")
metadata_options = with_options(
    click.option("--title", metavar="TEXT", help="Title of the scene, stored in the file."),
    click.option("--author", metavar="TEXT", help="Author of the photographs, stored in the file."),
    click.option(
        "--licence", metavar="TEXT", help="Licence of the photographs, such as CC-BY-4.0, stored in the file."
    ),
    click.option(
        "--date", callback=_parse_date, metavar="YYYY-MM-DD", help="Date of the photographs, stored in the file."
    ),
)


@parsed
def parse_selection(value: str) -> Selection:
    """Parse the text of `--views`; the library checks whether the views exist."""
    if value in ("auto", "all"):
        return Auto() if value == "auto" else All()
    return _count_or_names(value)


@parsed
def parse_guides(value: str) -> Guides:
    """Parse the text of `--guides`: None for auto, () for none, else how many or names, as for `--views`."""
    if value in ("auto", "none"):
        return None if value == "auto" else ()
    return _count_or_names(value)


@parsed
def parse_checks(value: str) -> int:
    """Parse the text of `--checks`: a number, or none."""
    if value == "none":
        return 0
    if not value.isdecimal() or len(value) > LONGEST_NUMBER:
        raise ValueError(f"{value[:40]!r} is neither a number of photographs nor none.")
    return int(value)


def _count_or_names(value: str) -> Spread | tuple[str, ...]:
    """Return a number without a comma as a count, else the names between commas.

    `\\,` is a comma in a name. A comma after the last one is allowed (`7,`).
    """
    if value.isdecimal() and len(value) <= LONGEST_NUMBER:
        return Spread(int(value))
    parts = re.split(r"(?<!\\),", value)
    if len(parts) > 1 and not parts[-1]:
        parts.pop()
    items = tuple(item.strip().replace("\\,", ",") for item in parts)
    if not all(items):
        raise ValueError(f"{value!r} names an empty view; use single commas, such as 0,5.")
    return items
