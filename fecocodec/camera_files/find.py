"""Find and read the cameras of a scene folder, in any supported format."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from fecocodec.camera_files.formats import camera_files, cameras_elsewhere, read_format
from fecocodec.camera_files.image_matching import short_name
from fecocodec.camera_files.no_cameras import why_no_cameras
from fecocodec.camera_files.other_cameras import unread_cameras
from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.camera_files.realestate10k import realestate10k_files
from fecocodec.camera_files.transforms_json import FILE_NAMES
from fecocodec.errors import InputError
from fecocodec.input_file import StrPath
from fecocodec.poses.unposed_photographs import find_photographs


def read_cameras(path: StrPath, *, are_images_needed: bool = True) -> PosedPhotographs:
    """Read the cameras of a scene folder or of a camera file, in the first format found.

    Images are not read. are_images_needed: whether to tell of these, too, if there are no cameras.
    Raises InputError if there are no cameras or they cannot be read.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise InputError(f"{path}: no such folder; give the folder that holds images and cameras.")
        found = camera_files(path)
        if not found:
            raise InputError(f"{path}: {why_no_cameras(path, are_images_needed=are_images_needed)}")
        scene = read_format(path, found[0])
        folder = path if path.is_dir() else path.parent
        others = _others(folder, found)
        remarks = _remarks(folder, found, others) if path.is_dir() else []
        posed_elsewhere = _images_of(folder, others)
    except (OSError, ValueError) as error:  # ValueError: an invalid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the path and its permissions.") from error
    return replace(scene, remarks=(*scene.remarks, *remarks), posed_elsewhere=posed_elsewhere)


def has_cameras(path: StrPath) -> bool:
    """Return whether there is a camera file, or nothing from which cameras could be estimated.

    Photographs without a camera file are the only case for which the answer is no.
    """
    path = Path(path)
    try:
        return bool(camera_files(path)) or not find_photographs(path)
    except (OSError, ValueError):  # `read_cameras` reports it
        return True


def _others(folder: Path, found: list[Path]) -> list[Path]:
    """Return camera files of kinds that are read beside the first, which is read."""
    further = [path for name in FILE_NAMES if (path := folder / name).is_file()] + realestate10k_files(folder)
    return [path for path in dict.fromkeys((*found, *further)) if path != found[0]]


def _images_of(folder: Path, others: list[Path]) -> frozenset[Path]:
    """Return the images of other camera files; not of COLMAP models, which may take seconds to read."""
    images = set[Path]()
    for path in others:
        with suppress(InputError):
            images |= {image.path for image in read_format(folder, path).photographs} if path.is_file() else set()
    return frozenset(images)


def _remarks(folder: Path, found: list[Path], others: list[Path]) -> list[str]:
    """Return sentences on camera files beside the first, which is read."""
    notes = []
    if others:
        names = ", ".join(str(path.relative_to(folder)) for path in others)
        has, it = ("has", "it") if len(others) == 1 else ("have", "one of them")
        notes.append(f"{names} {has} cameras, too, which are not used; give {it} in place of the folder to use it.")
    known = {*found, *others, *cameras_elsewhere(folder)}
    if folder in found:  # it is itself a COLMAP model
        known |= {folder / "cameras.bin", folder / "cameras.txt"}
    if unread := unread_cameras(folder, known):
        notes.append(f"cameras in {unread} are not read; those of {short_name(found[0])} are used.")
    return notes
