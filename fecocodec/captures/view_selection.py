"""Choice of views that depends on the photographs of a scene: `spread:4`, `auto` or `all`."""

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


@dataclass(frozen=True)
class All:
    """All views, even those that harm the others."""


Selection = tuple[int | str, ...] | Spread | Auto | All


def resolve(folder: Path, selection: Selection | None) -> tuple[int | str, ...] | None:
    """Return the `views` argument of `read_views`. `Spread`, `Auto` and `All` need the cameras of the folder.

    Raises InputError if the cameras cannot be read or the folder has too few views.
    """
    if not isinstance(selection, Spread | Auto | All):
        return selection
    # Imported here, so that options can be parsed without loading torch.
    from fecocodec.camera_files.find import read_cameras
    from fecocodec.captures.view_spread import auto_views, spread_views

    scene = read_cameras(folder)
    if isinstance(selection, All):
        return tuple(range(len(scene.photographs)))
    if isinstance(selection, Auto):
        return auto_views(scene)
    try:
        return spread_views(scene, selection.count)
    except InputError as error:
        raise InputError(f"{folder}: {error}") from error


def may_leave_out(selection: Selection | None) -> bool:
    """Return whether views that harm the others may be left out: the user named none, and did not ask for all."""
    return selection is None or isinstance(selection, Spread | Auto)
