"""Masks of photographs: images of which black is to be ignored, as in nerfstudio (`mask_path`) and COLMAP."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.photographs.image_headers import has_image_name, is_mask_folder
from fecocodec.photographs.images import read_photograph
from fecocodec.photographs.lens import ASPECT_TOLERANCE

FOLDER = "masks"
_NAME_OF_MASK = re.compile(r"[_.-]masks?$")  # what may follow the name of the photograph
_WORDS = {"mask", "masks", "alpha", "alphas", "matte", "mattes", "segmentation", "segmentations"}
_DEPTH = 3  # folders above a photograph in which a folder of masks is looked for
_BRIGHT = 128  # level from which on a pixel is not black, if the mask has any such pixel


def find_mask(photograph: Path) -> Path | None:
    """Return the mask of a photograph in a folder `masks` beside it, or beside a folder that it is in; None without.

    The mask of `images/cam1/a.jpg` is `masks/cam1/a.jpg.png`, as COLMAP names it, `masks/cam1/a.jpg` or
    `masks/cam1/a.png`, else the first image with such a name in another case, with another suffix, or as `a_mask.png`.
    """
    for base, folder in mask_folders(photograph):
        relative = photograph.relative_to(base)
        for name in [relative, Path(*relative.parts[1:])] if len(relative.parts) > 1 else [relative]:
            found = folder / name
            candidates = (found.with_name(f"{found.name}.png"), found, found.with_suffix(".png"), *_similar(found))
            if mask := next((path for path in candidates if os.path.isfile(path) and path != photograph), None):
                return mask
    return None


def mask_folders(photograph: Path) -> Iterator[tuple[Path, Path]]:
    """Yield (folder, its folder of masks) for the folders above a photograph that have one."""
    for base in photograph.parents[:_DEPTH]:
        named = (path for path in _entries(base) if is_mask_folder(path.name))
        yield from ((base, folder) for folder in named if folder.is_dir())


def unread_mask(photograph: Path) -> Path | None:
    """Return a mask of a photograph, by its name or that of its folder, where masks are not read; None if none."""
    others = (path for base in photograph.parents[:_DEPTH] for path in _entries(base) if _WORDS & {*_words(path.name)})
    folders = (path for path in others if path.is_dir() and not is_mask_folder(path.name))
    beside = (path for path in _entries(photograph.parent) if path != photograph and _WORDS & {*_words(path.stem)})
    wanted = [_words(photograph.name), _words(photograph.stem)]
    images = (*beside, *(path for folder in folders for path in _entries(folder)))
    names = ((path, [word for word in _words(path.stem) if word not in _WORDS]) for path in images)
    return next((path for path, words in names if words in wanted and has_image_name(path)), None)


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\W_]+", name.lower()) if word]


def _similar(wanted: Path) -> list[Path]:
    names = {wanted.name.lower(), wanted.stem.lower()}
    images = (path for path in _entries(wanted.parent) if has_image_name(path))
    return [path for path in images if _NAME_OF_MASK.sub("", path.stem.lower()) in names]


def _entries(folder: Path) -> list[Path]:
    """Return what is in a folder; nothing if it is not there or cannot be read."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def read_mask(path: Path, height: int, width: int) -> Bool[Tensor, "height width"]:
    """Return where a mask is black, for a photograph of this size in pixels; the mask may be larger or smaller.

    Black is darker than mid-grey; in a mask without brighter pixels, such as one of 0 and 1, it is 0. If parts of a
    mask are transparent, these are black, and the rest is white.
    Raises InputError if the mask cannot be read or has another shape.
    """
    mask = read_photograph(path)
    levels = (255 * (mask.colour.amax(dim=0) if mask.alpha is None else mask.alpha)).round()
    rows, columns = levels.shape
    if abs(rows * width - columns * height) > ASPECT_TOLERANCE * columns * height:
        raise InputError(
            f"{path}: the mask has {columns}x{rows} pixels and its photograph {width}x{height}; give it the shape of "
            "the photograph."
        )
    is_kept = levels >= (_BRIGHT if int(levels.max()) >= _BRIGHT else 1)
    resized = F.interpolate(is_kept[None, None].float(), (height, width), mode="nearest-exact")
    return resized[0, 0] == 0


def cut_out(
    colour: Float[Tensor, "3 height width"],
    alpha: Float[Tensor, "height width"] | None,
    ignored: Bool[Tensor, "height width"],
    level: float,
) -> tuple[Float[Tensor, "3 height width"], Float[Tensor, "height width"]]:
    """Return colour, composited on a grey level, and opacity of a photograph that is transparent where ignored."""
    opacity = torch.ones_like(colour[0]) if alpha is None else alpha
    return torch.where(ignored, level, colour), torch.where(ignored, 0.0, opacity)
