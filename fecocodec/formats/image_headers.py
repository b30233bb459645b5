"""Kinds and sizes of photographs, without their pixels and without torch."""

from pathlib import Path

from fecocodec.formats.input_file import StrPath
from fecocodec.formats.pillow_images import size_with_pillow

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")


def read_image_size(path: StrPath) -> tuple[int, int]:
    """Return (height, width) of the stored pixels, from the header alone. Raises InputError as `read_image` does."""
    path = Path(path)
    if path.suffix.lower() != ".exr":
        return size_with_pillow(path)
    from fecocodec.formats.exr import read_exr_size  # it loads torch

    return read_exr_size(path)
