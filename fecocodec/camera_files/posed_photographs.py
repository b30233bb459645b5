"""Photographs with cameras, before pixels are read; the common result of all camera formats."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.input_file import require_regular_file
from fecocodec.photographs.image_headers import IMAGE_SUFFIXES, read_image_size
from fecocodec.photographs.lens import Lens, require_representable, undistorted


@dataclass(frozen=True)
class PosedPhotograph:
    """One photograph with its camera.

    path: the image file, which need not exist. place: location of the camera in its file, for messages.
    camera_to_world: OpenCV axes, as stored (not validated). lens_for: (width, height) of the stored pixels -> lens.
    sparse_depths: depths, in scene units, of the reconstructed points that this photograph observes, if the format has
    them. declared_size: (width, height) in pixels that the camera file states, None if it states none.
    """

    path: Path
    place: str
    camera_to_world: Float[np.ndarray, "4 4"]
    lens_for: Callable[[int, int], Lens]
    sparse_depths: Float[np.ndarray, " point"] = field(default_factory=lambda: np.zeros(0))
    declared_size: tuple[int, int] | None = None


@dataclass(frozen=True)
class PosedPhotographs:
    """All photographs of a scene folder, in the order of its camera file. near, far: depth bounds of that file."""

    cameras_path: Path
    photographs: list[PosedPhotograph]
    near: float | None = None
    far: float | None = None


def require_images(photographs: list[PosedPhotograph]) -> None:
    """Raise InputError, which names the first one and counts the others, if images are missing."""
    missing = [photograph for photograph in photographs if not _is_file(photograph)]
    if not missing:
        return
    first = f"{missing[0].place}: there is no image {missing[0].path}"
    if len(missing) == 1:
        raise InputError(f"{first}; put it there or leave this view out by `views`.")
    raise InputError(
        f"{first}, and of {len(photographs)} images {len(missing)} are missing in all; put them there or choose others "
        "by `views`."
    )


def stored_lens(photograph: PosedPhotograph) -> tuple[Lens, Lens]:
    """Return the lens of a photograph and the pinhole to which it is undistorted. Reads only the image's header.

    Raises InputError if there is no image, or image and lens do not match.
    """
    require_images([photograph])
    height, width = read_image_size(photograph.path)
    lens = photograph.lens_for(width, height)
    require_representable(lens, photograph.place)
    return lens, undistorted(lens, photograph.place)


def known_pinhole(photograph: PosedPhotograph, size: tuple[int, int] | None = None) -> Lens:
    """Return the pinhole to which a photograph is undistorted; the photograph need not exist.

    Without a photograph, the lens is for the size that the camera file states, else for `size` = (height, width).
    Raises InputError if no size is known, or the lens is not valid.
    """
    if photograph.path.is_file():
        return stored_lens(photograph)[1]
    declared = photograph.declared_size or (size and (size[1], size[0]))
    if declared is None:
        raise InputError(
            f"{photograph.place}: there is no image {photograph.path}, and the camera file states no image size; "
            "put the image there or give `size`."
        )
    lens = photograph.lens_for(*declared)
    require_representable(lens, photograph.place)
    return undistorted(lens, photograph.place)


def find_image(folder: Path, name: str) -> Path:
    """Return the path of the image `name` in `folder`; a name without an image suffix gets the first existing one.

    The file need not exist, because the view may not be needed.
    """
    path = folder / name.replace("\\", "/")
    if not path.name or path.suffix.lower() in IMAGE_SUFFIXES:
        return path
    candidates = (path.with_name(path.name + suffix) for suffix in IMAGE_SUFFIXES)
    return next((candidate for candidate in candidates if candidate.is_file()), path)


def _is_file(photograph: PosedPhotograph) -> bool:
    """Return whether the image exists. Raises InputError if it cannot be looked at or is no regular file."""
    try:
        if photograph.path.exists() and not photograph.path.is_dir():
            require_regular_file(photograph.path)
        return photograph.path.is_file()
    except OSError as error:
        raise InputError(
            f"{photograph.place}: its image {photograph.path} cannot be looked at ({error.strerror}); check its name "
            "and the permissions of its folder."
        ) from error


def require_numbers(values: object, shape: tuple[int, ...], place: str) -> Float[np.ndarray, "*shape"]:
    """Convert values to float64. Raises InputError, which begins with `place`, for another shape, NaN or infinity."""
    if values is None:  # which NumPy converts to NaN
        raise InputError(f"{place}: {shape_text(shape)} expected; export the cameras again.")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{place}: {shape_text(shape)} expected; export the cameras again.") from error
    if array.shape != shape:
        raise InputError(
            f"{place}: {shape_text(shape)} expected, {shape_text(array.shape)} found; export the cameras again."
        )
    if not np.isfinite(array).all():
        raise InputError(f"{place}: a camera value is NaN or infinite; correct it or take this view out of the file.")
    return array


def shape_text(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    return f"{math.prod(shape)} numbers" if len(shape) == 1 else f"{'x'.join(map(str, shape))} numbers"
