"""What a command says: data on stdout, talk on stderr."""

import json

import click


def print_json(value: object) -> None:
    """Machine-readable result on stdout."""
    click.echo(json.dumps(value, indent=2))


def print_table(rows: list[tuple[str, str]]) -> None:
    """Two aligned columns on stdout."""
    width = max((len(name) for name, _ in rows), default=0)
    for name, value in rows:
        click.echo(f"{name:<{width}}  {value}")


def say(sentence: str) -> None:
    """Talk to the person at the terminal, on stderr."""
    click.echo(sentence, err=True)
