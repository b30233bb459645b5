"""What a command says: data on stdout, talk on stderr."""

import json
from collections.abc import Sequence

import click


def print_json(value: object) -> None:
    """Machine-readable result on stdout."""
    click.echo(json.dumps(value, indent=2))


def print_fields(fields: Sequence[tuple[str, str]]) -> None:
    """Names and values on stdout, values aligned."""
    width = max(len(name) for name, _ in fields)
    for name, value in fields:
        click.echo(f"{name:<{width}}  {value}")


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Rows of equally many cells on stdout, aligned; whole numbers are set to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (_aligned(cell, width) for cell, width in zip(row, widths, strict=True))
        click.echo("  ".join(cells).rstrip())


def say(sentence: str) -> None:
    """Talk to the person at the terminal, on stderr."""
    click.echo(sentence, err=True)


def _aligned(cell: str, width: int) -> str:
    return cell.rjust(width) if cell.replace(",", "").isdecimal() else cell.ljust(width)
