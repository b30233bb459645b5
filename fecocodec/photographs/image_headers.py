"""Kinds and sizes of photographs, without their pixels and without torch."""

import re
from collections.abc import Iterable
from pathlib import Path

from fecocodec.errors import InputError
from fecocodec.input_file import StrPath, require_regular_file
from fecocodec.photographs.pillow_images import RAW_SUFFIXES, UPRIGHT, orientation_with_pillow, size_with_pillow

IMAGE_SUFFIXES = (
    ".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".webp", ".avif", ".heic", ".heif", ".hif", ".tif", ".tiff", ".bmp",
    ".exr",
)  # fmt: skip
UNREAD_SUFFIXES = (*RAW_SUFFIXES, ".gif", ".jp2", ".jxl", ".ppm", ".psd", ".tga", ".hdr")
PHOTOGRAPH_FOLDERS = ("images", "input")  # where programs keep photographs; `input` is that of the 3DGS reference
_MAP = re.compile(r"(.+)[_.-](depth|disparity|normals?|masks?|alpha|confidence)([_.-]?\d+)?", re.IGNORECASE)
_EXR_SIGNATURE = b"v/1\x01"


def has_image_name(path: Path) -> bool:
    """Return whether a file is an image by its name. Hidden files, such as macOS's `._a.jpg`, are not."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def is_unread(path: Path) -> bool:
    """Return whether a file is, by its name, a photograph of a kind that cannot be read."""
    return path.suffix.lower() in UNREAD_SUFFIXES and not path.name.startswith(".")


def maps_among(paths: Iterable[Path]) -> set[Path]:
    """Return images that are, by their names, maps of other ones: `a_depth.png` or `a.mask.png` beside `a.jpg`."""
    files = list(paths)
    shown = {name for path in files for name in (path.stem, path.name)}
    return {path for path in files if (found := _MAP.fullmatch(path.stem)) and found[1] in shown}


def conversion_advice(unread: list[Path]) -> str:
    """Return what to do with photographs of kinds that cannot be read."""
    if all(path.suffix.lower() in RAW_SUFFIXES for path in unread):
        return "develop RAW photographs to JPEG, TIFF or PNG"
    return "convert them to JPEG, PNG or WebP"


def is_exr(path: Path) -> bool:
    """Return whether a file is OpenEXR, by its first bytes; by its name if they cannot be read."""
    try:
        require_regular_file(path)  # a pipe would block
        with path.open("rb") as file:
            return file.read(len(_EXR_SIGNATURE)) == _EXR_SIGNATURE
    except (OSError, InputError):
        return path.suffix.lower() == ".exr"


def is_upright(path: Path) -> bool:
    """Return whether the stored pixels are upright by the EXIF orientation. Raises InputError as `read_image` does."""
    return is_exr(path) or orientation_with_pillow(path) == UPRIGHT


def read_image_size(path: StrPath) -> tuple[int, int]:
    """Return (height, width) of the stored pixels, from the header alone. Raises InputError as `read_image` does."""
    path = Path(path)
    if not is_exr(path):
        return size_with_pillow(path)
    from fecocodec.photographs.exr import read_exr_size  # it loads torch

    return read_exr_size(path)
