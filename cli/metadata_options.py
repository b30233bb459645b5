"""Options for the metadata of a stream: --title, --author, --licence, --date."""

import datetime

import click

from .options import Function

METADATA = ("title", "author", "licence", "date")


def metadata_options(function: Function) -> Function:
    """Add the options; they are passed under their names, None if left out."""
    texts = {
        "title": "Title of the scene, stored in the file.",
        "author": "Author of the photographs, stored in the file.",
        "licence": "Licence of the photographs, such as CC-BY-4.0, stored in the file.",
    }
    function = click.option(
        "--date", callback=_parse_date, metavar="YYYY-MM-DD", help="Date of the photographs, stored in the file."
    )(function)
    for name, text in reversed(texts.items()):
        function = click.option(f"--{name}", metavar="TEXT", help=text)(function)
    return function


def _parse_date(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    if value is None:
        return None
    try:
        return datetime.date.fromisoformat(value).isoformat()
    except ValueError as error:
        raise click.BadParameter(f"{value[:40]!r} is not a date like 2026-05-31.", ctx, param) from error
