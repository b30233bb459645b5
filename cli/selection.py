"""View selection by `--views`: `0,5`, `left.jpg,right.jpg`, `spread:4` or `auto`."""

from dataclasses import dataclass
from pathlib import Path

import click

from .error_context import OF_VIEWS, error_context


@dataclass(frozen=True)
class Spread:
    """`count` views, as far apart as possible while they overlap."""

    count: int


@dataclass(frozen=True)
class Auto:
    """At most eight overlapping views that cover the middle of the capture."""


Selection = tuple[int | str, ...] | Spread | Auto


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
    items = tuple(item.strip() for item in value.split(","))
    if not all(items):
        raise click.BadParameter(f"{value!r} names an empty view; use single commas, such as 0,5.", ctx, param)
    return items


def resolve(folder: Path, selection: Selection | None) -> tuple[int | str, ...] | None:
    """Return the `views` argument for the library. `spread` and `auto` are resolved with the cameras of the folder."""
    if not isinstance(selection, Spread | Auto):
        return selection
    from fecocodec.formats.camera_files import read_cameras
    from fecocodec.formats.view_spread import auto_views, spread_views

    scene = read_cameras(folder)
    if isinstance(selection, Auto):
        return auto_views(scene)
    with error_context(folder, OF_VIEWS):
        return spread_views(scene, selection.count)
