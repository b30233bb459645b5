"""What a command prints: data on stdout, messages on stderr."""

import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import click

from fecocodec.errors import OutputError

_OPTIONS = ("views", "size", "near", "far", "background", "overwrite")  # arguments of the library that are options here


def print_json(value: object) -> None:
    """Machine-readable result on stdout."""
    _print(json.dumps(value, indent=2))


def print_fields(fields: Sequence[tuple[str, str]]) -> None:
    """Names and values on stdout, values aligned."""
    width = max(len(name) for name, _ in fields)
    for name, value in fields:
        _print(f"{name:<{width}}  {value}")


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Rows of equally many cells on stdout, aligned; whole numbers are set to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (_aligned(cell, width) for cell, width in zip(row, widths, strict=True))
        _print("  ".join(cells).rstrip())


def write_stdout(data: bytes) -> None:
    """Binary data on stdout. Raises OutputError where that is a terminal, or writing fails."""
    if sys.stdout.isatty():
        raise OutputError("standard output: this is a terminal; send the data to a file or another program.")
    with _stdout_errors():
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()


def say(sentence: str) -> None:
    """A message to the user, on stderr."""
    click.echo(sentence, err=True)


def in_options(sentence: str) -> str:
    """Return a sentence of the library with its arguments (`views`) under the names of the options (--views)."""
    return re.sub(rf"`({'|'.join(_OPTIONS)})`", r"--\1", sentence)


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
