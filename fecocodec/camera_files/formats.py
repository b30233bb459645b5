"""All formats of cameras that are read: which files of a folder are of these, and the reader of each."""

from contextlib import suppress
from pathlib import Path

from fecocodec.camera_files.camera_names import has_camera_name, walk
from fecocodec.camera_files.colmap import find_colmap_model, read_colmap
from fecocodec.camera_files.llff import find_llff, is_llff, read_llff
from fecocodec.camera_files.other_cameras import program_of
from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.camera_files.realestate10k import find_realestate10k, has_camera_line, read_realestate10k
from fecocodec.camera_files.transforms_json import (
    find_cameras_json,
    find_transforms_json,
    holds_cameras,
    read_transforms_json,
)
from fecocodec.errors import InputError

_FINDERS = (find_transforms_json, find_colmap_model, find_realestate10k, find_cameras_json, find_llff)
_TABLES = ("cameras.bin", "cameras.txt", "images.bin")  # of COLMAP; `images.txt` may be a list of names


def camera_files(path: Path) -> list[Path]:
    """Return the camera files of all formats in a scene folder, or `path` if it is one; the first is to be read.

    Raises InputError for a camera file of another program.
    """
    if path.is_file() and (program := program_of(path)):
        raise InputError(
            f"{path}: cameras of {program} are not read; convert them to a transforms.json or a COLMAP model, or give "
            "the folder of the photographs to estimate them."
        )
    return [found for find in _FINDERS if (found := find(path))]


def read_format(path: Path, found: Path) -> PosedPhotographs:
    """Read one of the `camera_files` of a scene folder. Raises InputError if it is not valid."""
    if found.is_dir() and found == find_colmap_model(path):
        return read_colmap(path)
    if found.suffix.lower() == ".npy":
        return read_llff(found)
    return read_realestate10k(found) if found.suffix.lower() == ".txt" else read_transforms_json(found)


def cameras_elsewhere(folder: Path) -> list[Path]:
    """Return cameras in and below a folder that has none where they usually lie. Folders of COLMAP may lack a table."""
    return list(dict.fromkeys(found for path in walk(folder) if (found := _cameras_at(path, path.parent == folder))))


def _cameras_at(path: Path, is_here: bool) -> Path | None:
    """Return a camera file, or the folder of a table of COLMAP. is_here: whether it lies in the scene folder itself."""
    if path.name in _TABLES:
        return None if is_here else path.parent
    is_one = False
    with suppress(OSError):
        if path.suffix.lower() == ".json":
            is_one = (is_here or has_camera_name(path)) and holds_cameras(path)
        elif not is_here and path.is_file():
            is_one = is_llff(path) or (path.suffix.lower() == ".txt" and has_camera_line(path))
    return path if is_one else None


def named_images(path: Path) -> list[Path]:
    """Return the images, which need not exist, of the cameras of a file or folder; none if these cannot be read."""
    with suppress(InputError, OSError):
        for found in camera_files(path)[:1]:
            return [photograph.path for photograph in read_format(path, found).photographs]
    return []
