"""Prepare photographs without cameras for pose estimation: upright copies of moderate size and focal lengths."""

from collections import defaultdict
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import ExifTags, Image, ImageOps

from fecocodec.errors import InputError
from fecocodec.limits import MIN_SIDE
from fecocodec.photographs.image_headers import UNREAD_SUFFIXES, has_image_name
from fecocodec.photographs.pillow_images import decode_with_pillow, unreadable
from fecocodec.poses.estimated_cameras import ImageGroup

MAX_PHOTOGRAPHS = 60
MAX_SIDE_PX = 1600  # of the copies from which features are extracted
# Without EXIF data: the median of 8 training captures, in longer image sides (a 27 mm lens on 35 mm film).
FOCAL_PRIOR = 0.75
_FILM_WIDTH_MM = 36.0
_LEAST_FOCAL, _LARGEST_FOCAL = 0.2, 20.0  # longer image sides; others are errors


def find_photographs(folder: Path) -> list[Path]:
    """Return the PNG, JPEG and WebP files of a folder, or of its folder `images`, in the order of their names."""
    for place in (folder, folder / "images"):
        if place.is_dir():
            files = [path for path in place.iterdir() if has_image_name(path) and path.is_file()]
            if found := sorted(path for path in files if path.suffix.lower() != ".exr"):
                return found
    return []


def unread_photographs(folder: Path) -> list[Path]:
    """Return photographs of kinds that cannot be read, such as HEIC, in a folder and in its folder `images`."""
    places = [place for place in (folder, folder / "images") if place.is_dir()]
    return sorted(path for place in places for path in place.iterdir() if path.suffix.lower() in UNREAD_SUFFIXES)


def upright_copies(photographs: list[Path], target: Path, focal_px: float | None = None) -> list[ImageGroup]:
    """Write an upright copy of every photograph to `target`, under its own name, with sides of at most 1600 pixels.

    Copies hold PNG data whatever their suffix; readers recognise the format by the content.
    focal_px: known focal length in pixels of the photographs, None to start from EXIF data or a standard lens.
    Returns groups of photographs of one size and focal length. Raises InputError for a photograph that cannot be read,
    is too small, two that are equal, or a focal length that cannot be that of all.
    """
    members: dict[tuple[tuple[int, int], float | None], list[str]] = defaultdict(list)
    name_of_pixels: dict[bytes, str] = {}
    sides: dict[int, str] = {}
    for path in photographs:
        image, focal, longer_side = _upright(path)
        if min(image.size) < MIN_SIDE:
            raise InputError(
                f"{path}: {image.size[0]}x{image.size[1]} pixels are too few, sides must be {MIN_SIDE} or more; give a "
                "larger photograph, or leave it out."
            )
        if focal_px is not None:
            focal = _given_focal(focal_px, path, longer_side, sides)
        pixels = image.tobytes()
        if (same := name_of_pixels.get(pixels)) is not None:
            raise InputError(f"{path}: this is the same picture as {same}; remove one of the two.")
        name_of_pixels[pixels] = path.name
        image.save(target / path.name, format="PNG", compress_level=1)
        members[image.size, focal].append(path.name)
    return [
        ImageGroup(
            tuple(names),
            (focal or FOCAL_PRIOR) * max(size),
            is_known=focal is not None and focal_px is None,
            is_fixed=focal_px is not None,
        )
        for (size, focal), names in members.items()
    ]


def _given_focal(focal_px: float, path: Path, longer_side: int, sides: dict[int, str]) -> float:
    """Return a given focal length in longer image sides. sides: names of earlier photographs by their longer side.

    Raises InputError if photographs differ in size, or for a focal length that no usual lens has.
    """
    sides.setdefault(longer_side, path.name)
    if len(sides) > 1:
        (side, name), *_ = sides.items()
        raise InputError(
            f"{path}: its longer side has {longer_side} pixels and that of {name} {side}, so one focal length in "
            "pixels does not fit both; bring the photographs to one size, or leave out `focal_px`."
        )
    focal = focal_px / longer_side
    if not _LEAST_FOCAL < focal < _LARGEST_FOCAL:
        raise InputError(
            f"{path}: a focal length of {focal_px:g} pixels does not fit its longer side of {longer_side} pixels; give "
            "`focal_px` in pixels of the photographs, not in millimetres."
        )
    return focal


def _upright(path: Path) -> tuple[Image.Image, float | None, int]:
    """Return the upright photograph, its focal length in longer image sides if EXIF data has it, and that side.

    The longer side is in pixels of the stored photograph.
    """
    samples = decode_with_pillow(path, path)  # reports damage and sizes beyond the limits as one sentence
    try:
        with Image.open(path) as stored:
            focal = _focal_of_exif(stored)
            image = _in_eight_bits(stored, samples) if stored.mode.startswith("I") else stored
            image = _on_white(ImageOps.exif_transpose(image))
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(unreadable(path, error)) from error
    longer_side = max(image.size)
    image.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX), Image.Resampling.LANCZOS)
    return image, focal, longer_side


def _in_eight_bits(stored: Image.Image, samples: Float[np.ndarray, "3 height width"]) -> Image.Image:
    """Return a grey image of 16 bits as RGB, with its EXIF data. Pillow would clip its values at 255."""
    pixels = np.rint(255.0 * samples).astype(np.uint8).transpose(1, 2, 0)
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.info = dict(stored.info)
    return image


def _on_white(image: Image.Image) -> Image.Image:
    if not image.has_transparency_data:
        return image.convert("RGB")
    colours = image.convert("RGBA")
    white = Image.new("RGBA", colours.size, "white")
    return Image.alpha_composite(white, colours).convert("RGB")


def _focal_of_exif(image: Image.Image) -> float | None:
    """Return the focal length in longer image sides from FocalLengthIn35mmFilm; None if it is missing or absurd."""
    value = image.getexif().get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.FocalLengthIn35mmFilm)
    try:
        focal = float(value) / _FILM_WIDTH_MM if value is not None else 0.0
    except (TypeError, ValueError):
        return None
    return focal if np.isfinite(focal) and _LEAST_FOCAL < focal < _LARGEST_FOCAL else None
