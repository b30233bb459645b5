"""Kinds and sizes of photographs, without their pixels and without torch."""

from pathlib import Path

from fecocodec.input_file import StrPath
from fecocodec.photographs.pillow_images import UPRIGHT, orientation_with_pillow, size_with_pillow

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")
UNREAD_SUFFIXES = (".heic", ".heif", ".avif", ".bmp", ".tif", ".tiff", ".dng", ".cr2", ".nef", ".arw")


def has_image_name(path: Path) -> bool:
    """Return whether a file is an image by its name. Hidden files, such as macOS's `._a.jpg`, are not."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def is_upright(path: Path) -> bool:
    """Return whether the stored pixels are upright by the EXIF orientation. Raises InputError as `read_image` does."""
    return path.suffix.lower() == ".exr" or orientation_with_pillow(path) == UPRIGHT


def read_image_size(path: StrPath) -> tuple[int, int]:
    """Return (height, width) of the stored pixels, from the header alone. Raises InputError as `read_image` does."""
    path = Path(path)
    if path.suffix.lower() != ".exr":
        return size_with_pillow(path)
    from fecocodec.photographs.exr import read_exr_size  # it loads torch

    return read_exr_size(path)
