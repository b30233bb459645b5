"""Choose the views of a scene: by index or name, by overlap, or all that can be used."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from fecocodec.camera_files.image_matching import similar_key
from fecocodec.camera_files.posed_photographs import (
    PosedPhotograph,
    PosedPhotographs,
    distinct_names,
    has_image,
    require_usable,
)
from fecocodec.captures.reading_notes import passed_over_notes
from fecocodec.captures.view_selection import LONGEST_NUMBER, All, Auto, Selection
from fecocodec.captures.view_spread import auto_views, spread_views
from fecocodec.errors import InputError, error_context
from fecocodec.limits import MAX_VIEWS

_LONGEST_SHOWN = 80  # characters of a name in messages


def select_views(
    scene: PosedPhotographs, selection: Selection | None, folder: Path, *, are_images_needed: bool = True
) -> tuple[list[PosedPhotograph], list[str]]:
    """Return the photographs that a selection means, and a note for each kind of photograph that is passed over.

    A photograph that has a problem or no image is passed over, unless the user names it: then it is an error. None
    selects all photographs that can be used, in any number. are_images_needed: False for cameras to render at.
    Raises InputError if none can be used, or the selection does not fit.
    """
    if isinstance(selection, tuple):
        chosen = choose_views(scene.photographs, selection, folder)
        require_usable(chosen, are_images_needed=are_images_needed)
        return chosen, []
    usable = [photograph for photograph in scene.photographs if is_usable(photograph, are_images_needed)]
    if not usable:
        raise no_view(scene)
    notes = passed_over_notes(scene, usable)
    if selection is None:
        return usable, notes
    if isinstance(selection, All):
        return choose_views(usable, tuple(range(len(usable))), folder), notes
    rest = replace(scene, photographs=usable)
    with error_context(folder):
        indices = auto_views(rest) if isinstance(selection, Auto) else spread_views(rest, selection.count)
    return [usable[index] for index in indices], notes


def is_usable(photograph: PosedPhotograph, are_images_needed: bool = True) -> bool:
    """Return whether a photograph has a pose and a lens that can be used, and an image."""
    try:
        return not photograph.problem and (not are_images_needed or has_image(photograph))
    except InputError:  # no regular file
        return False


def no_view(scene: PosedPhotographs) -> InputError:
    """Return the error for a scene without any photograph that can be used: the reason of the first one."""
    first = next((photograph for photograph in scene.photographs if photograph.problem), None)
    if first is not None:
        return InputError(first.problem)
    first = scene.photographs[0]
    beside = _of_this_name(first.path)
    remedy = f"put the images there{f' (one of this name is {beside[0]})' if beside else ''}"
    if len(beside) > 1:
        remedy = f"{len(beside)} have this name, as {beside[0]} and {beside[1]}; name each with its folder"
    return InputError(
        f"{first.place}: there is no image {first.path}, nor any other that {scene.cameras_name} names; {remedy}."
    )


def _of_this_name(path: Path) -> list[Path]:
    """Return the files of this name in folders below that of the path, or else beside it."""
    for folder in (path.parent, path.parent.parent):
        with suppress(OSError, ValueError):  # ValueError: an invalid file name
            found = [below / path.name for below in sorted(folder.iterdir()) if (below / path.name).is_file()]
            if found:
                return found
    return []


def choose_views(
    photographs: list[PosedPhotograph], chosen: tuple[int | str, ...], folder: Path
) -> list[PosedPhotograph]:
    """Return the chosen photographs, in the order given.

    A view is selected by its index from 0 (`3` and `"3"` are the same unless an image is named 3), by its file name,
    with or without suffix, or by the end of its path (`images/003.jpg`).
    Raises InputError if a view does not exist or is named twice, or the number of views is not 1 to MAX_VIEWS.
    """
    if not 1 <= len(chosen) <= MAX_VIEWS:
        raise InputError(f"{folder}: {len(chosen)} views chosen, but 1 to {MAX_VIEWS} can be used; change `views`.")
    return [photographs[index] for index in view_indices(photographs, chosen, folder)]


def view_indices(
    photographs: list[PosedPhotograph], chosen: tuple[int | str, ...], folder: Path, option: str = "views"
) -> list[int]:
    """Return the indices of the chosen photographs, see `choose_views`. option: that messages name."""
    named = [Path(photograph.name.replace("\\", "/")) for photograph in photographs]
    return indices_of([photograph.path for photograph in photographs], named, chosen, folder, option)


def indices_of(
    paths: list[Path], named: list[Path], chosen: tuple[int | str, ...], folder: Path, option: str
) -> list[int]:
    """Return the indices of the chosen photographs. named: what a camera file calls them. Raises InputError."""
    indices = [_find_view(paths, named, view, folder, option) for view in chosen]
    for index in indices:
        if indices.count(index) > 1:
            name = paths[index].name
            raise InputError(f"{folder}: view {name} is chosen twice; name each view once in `{option}`.")
    return indices


def _find_view(paths: list[Path], named: list[Path], view: int | str, folder: Path, option: str) -> int:
    if isinstance(view, str):
        found = [index for index, path in enumerate(paths) if _is_called(path, view)]
        found = found or [index for index, path in enumerate(named) if _is_called(path, view)]
        found = found or [index for index, path in enumerate(paths) if _is_called(path, view, similar_key)]
        if len(found) > 1:
            raise InputError(
                f"{folder}: {len(found)} views are called {view}; give more of its path, or an index, in `{option}`."
            )
        if found:
            return found[0]
        if not view.isdecimal() or len(view) > LONGEST_NUMBER:
            raise InputError(
                f"{folder}: no view is called {view[:_LONGEST_SHOWN]} (the first is {distinct_names(paths)[0]}); "
                f"give indices or names, with commas between them, in `{option}`."
            )
        view = int(view)
    if not 0 <= view < len(paths):
        raise InputError(f"{folder}: there is no view {view}; give indices from 0 to {len(paths) - 1} in `{option}`.")
    return view


def _is_called(path: Path, name: str, key: Callable[[str], str] = str) -> bool:
    """Return whether a name is the end of a path, with or without suffix. key: what similar names share."""
    parts = tuple(key(part) for part in Path(name.replace("\\", "/")).parts)
    own = tuple(key(part) for part in path.parts)
    return key(path.stem) == key(name) or (len(parts) > 0 and own[-len(parts) :] == parts)
