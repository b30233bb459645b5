"""Kinds and sizes of photographs, without their pixels and without torch."""

import re
from collections.abc import Iterable
from pathlib import Path

from fecocodec.input_file import StrPath, first_bytes
from fecocodec.photographs.orientation import UPRIGHT
from fecocodec.photographs.pillow_images import RAW_SUFFIXES, orientation_with_pillow, size_with_pillow

IMAGE_SUFFIXES = (
    ".png", ".apng", ".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".webp", ".avif", ".heic", ".heif", ".hif", ".tif",
    ".tiff", ".bmp", ".exr",
)  # fmt: skip
UNREAD_SUFFIXES = (
    *RAW_SUFFIXES, ".gif", ".jp2", ".j2k", ".j2c", ".jpf", ".jpx", ".jxl", ".ppm", ".pgm", ".pbm", ".pnm", ".psd",
    ".tga", ".hdr", ".dib", ".heics",
    ".jps", ".insp",  # JPEG of two pictures side by side
)  # fmt: skip
PHOTOGRAPH_FOLDERS = ("images", "input")  # where programs keep photographs; `input` is that of the 3DGS reference
_MASK_FOLDER = re.compile(r"masks?(?:_\d{1,2})?", re.IGNORECASE)  # nerfstudio keeps those of images_2 in masks_2
_KIND = r"(?:depth|disparity|normals?|masks?|alpha|confidence)"
_MAP = re.compile(rf"(.+)[_.-]{_KIND}(?:[_.-]?\d+)?|{_KIND}[_.-]?(.+)", re.IGNORECASE)
_PICTURE = re.compile(r"(?:rgb|colou?r|image|img|frame)[_.-]?(?=\d)|[_.-](?:rgb|colou?r|image|img)$", re.IGNORECASE)
_PLACEHOLDER = re.compile(r"\.(.+)\.icloud")  # of a file that is not downloaded
_SIGNATURE = re.compile(rb"\xff\xd8\xff|\x89PNG\r\n\x1a\n|RIFF.{4}WEBP", re.DOTALL)
_EXR_SIGNATURE = b"v/1\x01"


def has_image_name(path: Path) -> bool:
    """Return whether a file is an image by its name. Hidden files, such as macOS's `._a.jpg`, are not."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def is_unread(path: Path) -> bool:
    """Return whether a file is, by its name, a photograph of a kind that cannot be read."""
    return path.suffix.lower() in UNREAD_SUFFIXES and not path.name.startswith(".")


def is_misnamed(path: Path) -> bool:
    """Return whether a file is an image by its first bytes, but by its name neither one nor hidden."""
    is_image = _SIGNATURE.match(first_bytes(path, 12)) is not None
    return is_image and not (has_image_name(path) or is_unread(path) or path.name.startswith("."))


def maps_among(paths: Iterable[Path]) -> set[Path]:
    """Return images that are, by their names, maps of other ones.

    Such as `a_depth.png`, `a.mask.png` or `depth_a.png` beside `a.jpg`, and `depth_01.png` beside `rgb_01.png`.
    """
    files = list(paths)
    shown = {name for path in files for name in (path.stem, path.name, _PICTURE.sub("", path.stem))}
    return {path for path in files if (found := _MAP.fullmatch(path.stem)) and (found[1] or found[2]) in shown}


def is_mask_folder(name: str) -> bool:
    """Return whether a folder of this name holds masks."""
    return _MASK_FOLDER.fullmatch(name) is not None


def is_absent(path: Path) -> bool:
    """Return whether a file stands for an image that is not here: a link to none, or a placeholder of iCloud."""
    placeholder = _PLACEHOLDER.fullmatch(path.name)
    if placeholder:
        return has_image_name(Path(placeholder[1]))
    return has_image_name(path) and not path.exists()


def conversion_advice(unread: list[Path]) -> str:
    """Return what to do with photographs of kinds that cannot be read."""
    if all(path.suffix.lower() in RAW_SUFFIXES for path in unread):
        return "develop RAW photographs to JPEG, TIFF or PNG"
    return "convert them to JPEG, PNG or WebP"


def is_exr(path: Path) -> bool:
    """Return whether a file is OpenEXR, by its first bytes; by its name if they cannot be read."""
    head = first_bytes(path, len(_EXR_SIGNATURE))
    return head == _EXR_SIGNATURE if head else path.suffix.lower() == ".exr"


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
