"""What every camera format is read into, before any pixel is."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.formats.images import IMAGE_SUFFIXES, read_image_size
from fecocodec.formats.input_file import require_regular_file
from fecocodec.formats.lens import Lens, require_representable, undistorted


@dataclass(frozen=True)
class PosedPhotograph:
    """One photograph that has a camera.

    path: the image file, which need not exist yet. place: where the camera stands, for messages.
    camera_to_world: OpenCV axes, as written (not checked). lens_for: (width, height) of the stored pixels -> lens.
    sparse_depths: depths of reconstructed points that this photograph sees, where the format carries them.
    """

    path: Path
    place: str
    camera_to_world: Float[np.ndarray, "4 4"]
    lens_for: Callable[[int, int], Lens]
    sparse_depths: Float[np.ndarray, " point"] = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class PosedPhotographs:
    """All photographs of a scene folder in the order of its camera file, with the depth bounds the file states."""

    cameras_path: Path
    photographs: list[PosedPhotograph]
    near: float | None = None
    far: float | None = None


def stored_lens(photograph: PosedPhotograph) -> tuple[Lens, Lens]:
    """The lens of a photograph as it is stored, and the pinhole it is undistorted to; reads the image's header.

    Raises InputError where there is no image, or it and its lens do not go together.
    """
    _require_file(photograph)
    height, width = read_image_size(photograph.path)
    lens = photograph.lens_for(width, height)
    require_representable(lens, photograph.place)
    return lens, undistorted(lens, photograph.place)


def find_image(folder: Path, name: str) -> Path:
    """The image `name` in `folder`; a name without an image suffix gets the first suffix that exists.

    The path is returned even where no file is there: whether it is needed is known only later.
    """
    path = folder / name.replace("\\", "/")
    if not path.name or path.suffix.lower() in IMAGE_SUFFIXES:
        return path
    candidates = (path.with_name(path.name + suffix) for suffix in IMAGE_SUFFIXES)
    return next((candidate for candidate in candidates if candidate.is_file()), path)


def _require_file(photograph: PosedPhotograph) -> None:
    try:
        is_there = photograph.path.is_file()
        if photograph.path.exists() and not photograph.path.is_dir():
            require_regular_file(photograph.path)
    except OSError as error:
        raise InputError(
            f"{photograph.place}: its image {photograph.path} cannot be looked at ({error.strerror}); check its name "
            "and the permissions of its folder."
        ) from error
    if not is_there:
        raise InputError(
            f"{photograph.place}: there is no image {photograph.path}; put it there or leave this view out by `views`."
        )


def require_numbers(values: object, shape: tuple[int, ...], place: str) -> Float[np.ndarray, "*shape"]:
    """Finite float64 numbers of that shape. Raises InputError that begins with `place`."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{place}: {shape_text(shape)} expected; export the cameras again.") from error
    if array.shape != shape:
        raise InputError(f"{place}: {shape_text(shape)} expected, {array.shape} found; export the cameras again.")
    if not np.isfinite(array).all():
        raise InputError(f"{place}: a camera value is NaN or infinite; correct it or take this view out of the file.")
    return array


def shape_text(shape: tuple[int, ...]) -> str:
    return f"{math.prod(shape)} numbers" if len(shape) == 1 else f"{'x'.join(map(str, shape))} numbers"
