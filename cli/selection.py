"""Which views of a folder: `0,5`, `left.jpg,right.jpg` or `spread:4`."""

from dataclasses import dataclass
from pathlib import Path

import click

from .naming import OF_VIEWS, naming


@dataclass(frozen=True)
class Spread:
    """That many views, evenly spread over the folder."""

    count: int


Selection = tuple[int | str, ...] | Spread


def parse_selection(ctx: click.Context, param: click.Parameter, value: str | None) -> Selection | None:
    """Text of `--views` as a selection; whether the views exist is for the library to say."""
    if value is None:
        return None
    kind, _, count = value.partition(":")
    if kind == "spread":
        if not count.isdecimal():
            raise click.BadParameter(f"{value!r} is not spread:COUNT, such as spread:4.", ctx, param)
        return Spread(int(count))
    items = tuple(item.strip() for item in value.split(","))
    if not all(items):
        raise click.BadParameter(f"{value!r} names an empty view; use single commas, such as 0,5.", ctx, param)
    return items


def resolve(folder: Path, selection: Selection | None) -> tuple[int | str, ...] | None:
    """The views to ask the library for; an even spread needs to know how many the folder has."""
    if not isinstance(selection, Spread):
        return selection
    from fecocodec.formats.scene_folder import view_names
    from fecocodec.formats.view_choice import subsample

    num_available = len(view_names(folder))
    with naming(folder, OF_VIEWS):
        return subsample(num_available, selection.count)
