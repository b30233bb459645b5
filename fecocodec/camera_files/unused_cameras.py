"""Cameras below, beside and above photographs whose cameras are estimated: what is said of them."""

from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from tempfile import gettempdir

from fecocodec.camera_files.colmap_tables import is_colmap_model
from fecocodec.camera_files.formats import camera_files, cameras_elsewhere, named_images
from fecocodec.camera_files.other_cameras import unread_cameras, unread_cameras_around
from fecocodec.errors import InputError, some_of
from fecocodec.input_file import read_json
from fecocodec.poses.unposed_photographs import find_photographs

CONVERT = "convert them to a transforms.json or a COLMAP model"
_LEVELS_ABOVE = 2  # rgb/1x of Nerfies


def unread_cameras_notes(folder: Path, *, outcome: str = ", and cameras are estimated") -> list[str]:
    """Return sentences on camera files beside unposed photographs that are not read. outcome: what becomes of it."""
    if not folder.is_dir():
        return []
    elsewhere = cameras_elsewhere(folder)
    partial = [path for path in elsewhere if path.is_dir() and not is_colmap_model(path)]
    photographs = find_photographs(folder)
    unusual = [path for path in elsewhere if path not in partial and not _is_of_others(path, photographs)]
    notes = list[str]()
    if unread := unread_cameras(folder, set(elsewhere), len(photographs)):
        notes.append(f"cameras in {unread} are not read{outcome}; to use them, {CONVERT}.")
    if partial:
        names = some_of([path.relative_to(folder) for path in partial])
        notes.append(f"{names} has no images.bin or images.txt{outcome}; export it again.")
    if unusual:
        names = some_of([path.relative_to(folder) for path in unusual])
        notes.append(f"cameras in {names} are not looked for{outcome}; to use them, give {unusual[0]}.")
    if photographs and photographs[0].parent == folder:
        notes += _notes_above(folder, outcome)
    return notes


def earlier_estimate_notes(folder: Path) -> list[str]:
    """Return a sentence on saved cameras above the folder that were estimated for its photographs."""
    for parent in _above(folder) if folder.is_dir() else ():
        cameras, folders = _camera_files(parent), {path.parent.resolve() for path in named_images(parent)}
        if cameras and _is_estimate(cameras[0]) and folder.resolve() in folders:
            return [
                f"{cameras[0]} has cameras of an earlier estimate, but cameras are estimated again; to use those, give "
                f"the folder {parent}."
            ]
    return []


def _is_estimate(path: Path) -> bool:
    """Return whether `PosedFolder.save_cameras` wrote a camera file."""
    with suppress(InputError):
        scene = read_json(path) if path.suffix.lower() == ".json" else None
        return isinstance(scene, dict) and scene.get("is_estimated") is True
    return False


def _is_of_others(path: Path, photographs: list[Path]) -> bool:
    """Return whether cameras are of other photographs, which are there, as if of another scene in a folder below."""
    found = {image.name for image in named_images(path) if image.is_file()}
    return bool(found) and not found & {image.name for image in photographs}


def _notes_above(folder: Path, outcome: str) -> list[str]:
    """Return a sentence on cameras in the folders above the one of the photographs."""
    here, names = folder.resolve(), {path.name for path in find_photographs(folder)}
    for parent in _above(folder):
        cameras, named = _camera_files(parent), named_images(parent)
        if cameras and _is_estimate(cameras[0]):
            continue
        found = [path for path in named if path.is_file()]
        if any(path.parent.resolve() == here for path in found):
            return [f"{cameras[0]} has cameras{outcome}; to use them instead, give the folder {parent}."]
        if not found and names & {path.name for path in named}:
            return [
                f"{cameras[0]} has cameras of images with these names, but not in this folder{outcome}; to "
                f"use them, put the images into {named[0].parent} and give the folder {parent}."
            ]
    for level, parent in enumerate(_above(folder)):
        read = {folder.absolute(), *_camera_files(parent)}
        if unread := unread_cameras_around(parent, read, names, is_near=level == 0):
            return [
                f"cameras above the photographs ({unread} in {parent}) are not read{outcome}; to use them, {CONVERT}."
            ]
    return []


def _above(folder: Path) -> list[Path]:
    """Return the folders above one, the nearest first; not that of temporary files, where archives are unpacked."""
    parents = folder.absolute().parents[:_LEVELS_ABOVE]
    return list(takewhile(lambda parent: parent != Path(gettempdir()), parents))


def _camera_files(folder: Path) -> list[Path]:
    with suppress(InputError, OSError):
        return camera_files(folder)
    return []
