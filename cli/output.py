"""Printing: data to stdout, messages to stderr."""

import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum

import click

from fecocodec.errors import OutputError

_KEY = "fecosplat.verbosity"
_LONG_NAME = re.compile(r"(\S{300})\S{300,}(\S{100})")  # names in a damaged file may have any length


class Verbosity(Enum):
    """QUIET: warnings and errors. NORMAL: also results and progress. VERBOSE: also each step."""

    QUIET = 0
    NORMAL = 1
    VERBOSE = 2


def set_verbosity(ctx: click.Context, value: Verbosity) -> None:
    """Set the verbosity of a command."""
    ctx.meta[_KEY] = value


def verbosity() -> Verbosity:
    """Return the verbosity of the running command; NORMAL outside of one."""
    ctx = click.get_current_context(silent=True)
    value = Verbosity.NORMAL if ctx is None else ctx.meta.get(_KEY, Verbosity.NORMAL)
    assert isinstance(value, Verbosity)
    return value


# Arguments of the library, which its messages name in backticks, and the options with that meaning.
_NAMED_ALIKE = """views size near far background masks overwrite effort device sharpness stages photographs shard strict
guides checks frames focal_px save_cameras save_frames max_pixels extractor_weights seed textures precision
learning_rate lambda_range photograph_share optimised_share perceptual perceptual_weight"""
_OPTIONS = {
    **{name: f"--{name.replace('_', '-')}" for name in _NAMED_ALIKE.split()},
    "view_shares": "--views",
    "frozen": "--freeze",
    "num_scenes": "--scenes",
    "num_target": "--targets",
    "sizes": "--size",
    "one_stage_until": "--one-stage-steps",
    "bypass_until": "--bypass-steps",
    "kept_batches": "--keep",
    "start": "--from",
    "configuration": "--config",
    "disparity_weight": "--depth-weight",
    "masks=unused": "--masks unused",
    'stages="intact"': "decode --partial",
    "stages=1": "--stages 1",
    "spz_version=3": "--spz-version 3",
    "views=all": "--views all",
    "effort=fast": "--effort fast",
    "effort=best": "--effort best",
    "workers=1": "--workers 1",
}


def print_json(value: object) -> None:
    """Print a value as JSON to stdout. Raises OutputError if writing fails, as the other printing functions do.

    Control characters of untrusted text are escaped, also DEL, which JSON allows as it is.
    """
    _print(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


def print_fields(fields: Sequence[tuple[str, str]]) -> None:
    """Print (name, value) pairs to stdout, one per line, with aligned values."""
    width = max(len(name) for name, _ in fields)
    for name, value in fields:
        _print(f"{name:<{width}}  {value}")


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print a table to stdout. All rows have the same number of cells; whole numbers are right-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (_aligned(cell, width) for cell, width in zip(row, widths, strict=True))
        _print("  ".join(cells).rstrip())


def write_stdout(data: bytes) -> None:
    """Write binary data to stdout. Raises OutputError if stdout is a terminal, or if writing fails."""
    if sys.stdout.isatty():
        raise OutputError("standard output: this is a terminal; send the data to a file or another program.")
    with _stdout_errors():
        rest = memoryview(data)
        while rest:  # without a buffer (PYTHONUNBUFFERED), a write can end early, as when the reader closes the pipe
            rest = rest[sys.stdout.buffer.write(rest) :]
        sys.stdout.buffer.flush()


def say(sentence: str) -> None:
    """Print a message of one line to stderr, unless --quiet was given."""
    if verbosity() is not Verbosity.QUIET:
        warn(sentence)


def warn(sentence: str) -> None:
    """Print a warning or an error of one line to stderr, also if --quiet was given."""
    shown = _LONG_NAME.sub(r"\1...\2", sentence)
    click.echo(printable(shown), err=True)  # names of files can contain control characters


def in_options(sentence: str) -> str:
    """Replace names of library arguments (`views`) in a message by the names of the options (--views)."""
    return re.sub("`([^`]+)`", lambda found: _OPTIONS.get(found[1], found[0]), sentence)


def _print(line: str) -> None:
    with _stdout_errors():
        click.echo(line)


@contextmanager
def _stdout_errors() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # the reader has closed the pipe (`| head`); click ends the command quietly
        raise
    except OSError as error:
        raise OutputError(
            f"standard output: writing failed ({error.strerror}); check free space or send it elsewhere."
        ) from error


def _aligned(cell: str, width: int) -> str:
    return cell.rjust(width) if cell.replace(",", "").isdecimal() else cell.ljust(width)


def printable(text: str) -> str:
    """Escape control characters, line breaks and text-direction marks, for example as `\\x1b`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
