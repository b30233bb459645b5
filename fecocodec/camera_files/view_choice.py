"""Choose views by index or by name."""

from pathlib import Path

from fecocodec.camera_files.posed_photographs import PosedPhotograph
from fecocodec.errors import InputError
from fecocodec.limits import MAX_VIEWS

_LONGEST_NUMBER = 9  # digits
_LONGEST_SHOWN = 80  # characters of a name in messages


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
    paths = [photograph.path for photograph in photographs]
    indices = [_find_view(paths, view, folder, option) for view in chosen]
    for index in indices:
        if indices.count(index) > 1:
            raise InputError(f"{folder}: view {paths[index].name} is chosen twice; name each view once in `{option}`.")
    return indices


def _find_view(paths: list[Path], view: int | str, folder: Path, option: str) -> int:
    if isinstance(view, str):
        found = [index for index, path in enumerate(paths) if _is_called(path, view)]
        if len(found) > 1:
            raise InputError(
                f"{folder}: {len(found)} views are called {view}; give more of its path, or an index, in `{option}`."
            )
        if found:
            return found[0]
        if not view.isdecimal() or len(view) > _LONGEST_NUMBER:
            raise InputError(
                f"{folder}: no view is called {view[:_LONGEST_SHOWN]} (the first is {paths[0].name}); "
                f"give indices or names, with commas between them, in `{option}`."
            )
        view = int(view)
    if not 0 <= view < len(paths):
        raise InputError(f"{folder}: there is no view {view}; give indices from 0 to {len(paths) - 1} in `{option}`.")
    return view


def _is_called(path: Path, name: str) -> bool:
    parts = Path(name).parts
    return path.stem == name or (len(parts) > 0 and path.parts[-len(parts) :] == parts)
