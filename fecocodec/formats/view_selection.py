"""Choice of views that depends on the cameras of a scene: `spread:4` or `auto`."""

from dataclasses import dataclass
from pathlib import Path

from fecocodec.errors import InputError


@dataclass(frozen=True)
class Spread:
    """`count` views, as far apart as possible while they overlap."""

    count: int


@dataclass(frozen=True)
class Auto:
    """At most eight overlapping views that cover the middle of the capture."""


Selection = tuple[int | str, ...] | Spread | Auto


def resolve(folder: Path, selection: Selection | None) -> tuple[int | str, ...] | None:
    """Return the `views` argument of `read_views`. `Spread` and `Auto` are resolved with the cameras of the folder.

    Raises InputError if the cameras cannot be read or the folder has too few views.
    """
    if not isinstance(selection, Spread | Auto):
        return selection
    # Imported here, so that options can be parsed without loading torch.
    from fecocodec.formats.camera_files import read_cameras
    from fecocodec.formats.view_spread import auto_views, spread_views

    scene = read_cameras(folder)
    if isinstance(selection, Auto):
        return auto_views(scene)
    try:
        return spread_views(scene, selection.count)
    except InputError as error:
        raise InputError(f"{folder}: {error}") from error
