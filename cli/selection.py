"""Choice of photographs: `--views` (`0,5`, `left.jpg,right.jpg`, `spread:4`, `auto`, `all`), `--guides`, `--checks`."""

import click

from fecocodec.captures.view_choice import All, Auto, Selection, Spread


def parse_selection(ctx: click.Context, param: click.Parameter, value: str | None) -> Selection | None:
    """Parse the text of `--views`; the library checks whether the views exist."""
    if value is None:
        return None
    kind, _, count = value.partition(":")
    if kind == "spread":
        if not count.isdecimal() or len(count) > 9:
            raise click.BadParameter(f"{value[:40]!r} is not spread:COUNT, such as spread:4.", ctx, param)
        return Spread(int(count))
    if value == "auto":
        return Auto()
    if value == "all":
        return All()
    return _names(value, ctx, param)


def parse_guides(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Parse the text of `--guides`: None for auto, () for none, else names."""
    if value is None or value == "auto":
        return None
    return () if value == "none" else _names(value, ctx, param)


def parse_checks(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Parse the text of `--checks`: a number, or none."""
    if value is None:
        return None
    if value == "none":
        return 0
    if not value.isdecimal() or len(value) > 9:
        raise click.BadParameter(f"{value[:40]!r} is neither a number of photographs nor none.", ctx, param)
    return int(value)


def _names(value: str, ctx: click.Context, param: click.Parameter) -> tuple[str, ...]:
    items = tuple(item.strip() for item in value.split(","))
    if not all(items):
        raise click.BadParameter(f"{value!r} names an empty view; use single commas, such as 0,5.", ctx, param)
    return items
