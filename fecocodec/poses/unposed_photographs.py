"""Prepare photographs without cameras for pose estimation: upright copies of moderate size and focal lengths."""

import re
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from errno import ENAMETOOLONG
from hashlib import blake2b
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from fecocodec.errors import InputError
from fecocodec.limits import MIN_SIDE
from fecocodec.photographs.image_headers import (
    PHOTOGRAPH_FOLDERS,
    has_image_name,
    is_absent,
    is_exr,
    is_mask_folder,
    is_unread,
    maps_among,
    read_image_size,
)
from fecocodec.photographs.lens import require_known_model
from fecocodec.photographs.orientation import turned_upright
from fecocodec.photographs.pillow_images import exif_value, open_image, orientation_with_pillow, upright_with_pillow
from fecocodec.poses.estimated_cameras import ImageGroup

MAX_PHOTOGRAPHS = 200
MAX_SIDE_PX = 1600  # of the copies from which features are extracted
# Without EXIF data: the median of 8 training captures, in longer image sides (a 27 mm lens on 35 mm film).
FOCAL_PRIOR = 0.75
_FILM_WIDTH_MM = 36.0
_PROJECTION = re.compile(rb"ProjectionType\s*(?:=\s*[\"']|>)\s*(equirectangular|cylindrical)", re.I)  # of XMP, GPano
_LEAST_FOCAL, _LARGEST_FOCAL = 0.2, 20.0  # longer image sides; others are errors


def find_photographs(folder: Path) -> list[Path]:
    """Return the images of a folder, or of its folder `images` or `input` if more are there, in the order of names.

    Maps of other images (`maps_among`) are left out.
    """
    found = []
    for place in _places(folder):
        files = [path for path in place.iterdir() if has_image_name(path) and path.is_file()]
        found.append(sorted(set(files) - maps_among(files)))
    return max(found, key=len, default=[])


def unused_images(folder: Path) -> list[Path]:
    """Return the images that `find_photographs` leaves out, also two folders deep; masks are used."""
    used = set(find_photographs(folder))
    images = [
        path for pattern in ("*", "*/*", "*/*/*") for path in sorted(folder.glob(pattern)) if has_image_name(path)
    ]
    return [path for path in images if path not in used and path.is_file() and not _is_apart(path.relative_to(folder))]


def _is_apart(path: Path) -> bool:
    return any(part.startswith(".") or is_mask_folder(part) for part in path.parts[:-1])


def absent_photographs(folder: Path) -> list[Path]:
    """Return files that stand for photographs that are not here, at the places where `find_photographs` looks."""
    return sorted(path for place in _places(folder) for path in place.iterdir() if is_absent(path))


def _places(folder: Path) -> list[Path]:
    return [place for place in (folder, *(folder / name for name in PHOTOGRAPH_FOLDERS)) if place.is_dir()]


def unread_photographs(folder: Path, is_kind: Callable[[Path], bool] = is_unread) -> list[Path]:
    """Return photographs of kinds that cannot be read, at the places where `find_photographs` looks.

    A RAW file beside an image of the same name is left out: both are the same photograph.
    is_kind: what is looked for; `is_misnamed` for images whose name is not that of one.
    """
    files = [path for place in _places(folder) for path in place.iterdir()]
    read = {path.with_suffix("") for path in files if has_image_name(path)}
    return sorted(path for path in files if is_kind(path) and path.with_suffix("") not in read)


def upright_copies(
    photographs: list[Path], target: Path, focal_px: float | None = None, num_threads: int = -1
) -> tuple[list[ImageGroup], list[str]]:
    """Write an upright copy of every photograph to `target`, under its own name, with sides of at most 1600 pixels.

    Copies hold PNG data whatever their suffix; readers recognise the format by the content.
    focal_px: known focal length in pixels of the photographs, None to start from EXIF data or a standard lens.
    num_threads: that write copies while the next photographs are read, -1 for all cores.
    Returns groups of photographs of one size and focal length, and a sentence for each that is left out: damaged, too
    small, or the same picture as another. Raises InputError for a name that is not UTF-8, and for a focal length that
    cannot be that of all.
    """
    members: dict[tuple[tuple[int, int], float | None], list[str]] = defaultdict(list)
    name_of_pixels: dict[bytes, str] = {}
    sides: dict[int, str] = {}
    left_out = list[str]()
    with ThreadPoolExecutor(num_threads if num_threads > 0 else None) as threads:
        written = []
        for path in photographs:
            _require_utf8(path)
            try:
                image, focal, longer_side = _upright(path)
            except InputError as error:
                left_out.append(f"{path.name} is left out: {str(error).removeprefix(f'{path}: ')}")
                continue
            pixels = blake2b(image.tobytes()).digest()
            if min(image.size) < MIN_SIDE:
                reason = f"{image.size[0]}x{image.size[1]} pixels are too few, sides must be {MIN_SIDE} or more"
                left_out.append(f"{path.name} is left out: {reason}.")
                continue
            if (same := name_of_pixels.get(pixels)) is not None:
                left_out.append(f"{path.name} is left out: it is the same picture as {same}.")
                continue
            if focal_px is not None:
                focal = _given_focal(focal_px, path, longer_side, sides)
            name_of_pixels[pixels] = path.name
            written.append(threads.submit(image.save, target / path.name, format="PNG", compress_level=1))
            members[image.size, focal].append(path.name)
        for copy in written:
            copy.result()  # raises the error of one that failed
    groups = [
        ImageGroup(
            tuple(names),
            (focal or FOCAL_PRIOR) * max(size),
            is_known=focal is not None and focal_px is None,
            is_fixed=focal_px is not None,
        )
        for (size, focal), names in members.items()
    ]
    return groups, left_out


def _require_utf8(path: Path) -> None:
    """Raise InputError for a name that pycolmap cannot take."""
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: the name is not UTF-8; rename the file.") from error


def upright_masks(photographs: list[Path], target: Path) -> Path | None:
    """Write the masks of the photographs, of the size of their copies in `target`, as `masks/NAME.png` there.

    Returns the folder of the masks, white ones among them, because pycolmap leaves out photographs without a mask; None
    if no photograph has one. Raises InputError as `read_mask` does, and for a name of 252 bytes or more.
    """
    from fecocodec.photographs.masks import FOLDER, find_mask  # it loads torch

    masks = [find_mask(path) for path in photographs]
    if not any(masks):
        return None
    folder = target / FOLDER
    folder.mkdir()
    for path, mask in zip(photographs, masks, strict=True):
        height, width = read_image_size(target / path.name)
        kept = Image.new("L", (width, height), "white") if mask is None else _upright_mask(path, mask)
        try:
            kept.resize((width, height), Image.Resampling.NEAREST).save(folder / f"{path.name}.png")
        except OSError as error:
            if error.errno != ENAMETOOLONG:
                raise
            raise InputError(f"{path}: the name is too long for that of a mask; shorten it.") from error
    return folder


def _upright_mask(photograph: Path, mask: Path) -> Image.Image:
    """Return the mask of a photograph, of the size of that; masks are of the stored pixels or of the upright ones."""
    from fecocodec.photographs.masks import read_mask

    orientation = 1 if is_exr(photograph) else orientation_with_pillow(photograph)
    size, of_mask = read_image_size(photograph), read_image_size(mask)
    if orientation > 4 and (size[0] > size[1]) != (of_mask[0] > of_mask[1]):
        size, orientation = size[::-1], 1
    kept = Image.fromarray((~read_mask(mask, *size)).numpy()).convert("L")
    return turned_upright(kept, orientation)


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
    if is_exr(path):
        from fecocodec.photographs.images import read_eight_bits  # it loads torch

        image, focal = Image.fromarray(read_eight_bits(path)), None
    else:
        _require_no_panorama(path)
        image, focal = upright_with_pillow(path), _focal_of_exif(path)
    longer_side = max(image.size)
    image.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX), Image.Resampling.LANCZOS)
    return image, focal, longer_side


def _require_no_panorama(path: Path) -> None:
    """Raise InputError for a photograph that states a projection of panoramas, as 360-degree cameras and phones do."""
    with open_image(path, path) as image:
        xmp = image.info.get("xmp")
    if isinstance(xmp, bytes) and (found := _PROJECTION.search(xmp)):
        require_known_model(found[1].decode().upper(), str(path))


def _focal_of_exif(path: Path) -> float | None:
    """Return the focal length in longer image sides from FocalLengthIn35mmFilm; None if it is missing or absurd."""
    with open_image(path, path) as image:
        value = exif_value(image, ExifTags.Base.FocalLengthIn35mmFilm, ExifTags.IFD.Exif)
    try:
        focal = float(str(value)) / _FILM_WIDTH_MM
    except ValueError:
        return None
    return focal if np.isfinite(focal) and _LEAST_FOCAL < focal < _LARGEST_FOCAL else None
