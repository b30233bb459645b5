"""What a command says: data on stdout, talk on stderr."""

import json
from collections.abc import Sequence

import click

from fecocodec.errors import OutputError


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


def say(sentence: str) -> None:
    """Talk to the person at the terminal, on stderr."""
    click.echo(sentence, err=True)


def _print(line: str) -> None:
    try:
        click.echo(line)
    except BrokenPipeError:  # the reader has seen enough (`| head`); click ends the command quietly
        raise
    except OSError as error:
        raise OutputError(
            f"standard output: writing failed ({error.strerror}); check free space or send it elsewhere."
        ) from error


def _aligned(cell: str, width: int) -> str:
    return cell.rjust(width) if cell.replace(",", "").isdecimal() else cell.ljust(width)
