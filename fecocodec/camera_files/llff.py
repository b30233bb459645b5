"""Cameras in `poses_bounds.npy` of LLFF (Mildenhall et al. 2019): a row of 17 numbers for each image, in name order.

The first 15 are a 3x5 matrix: camera-to-world, whose axes are down, right and backwards, and a column with height,
width and focal length in pixels. The last two are the depths of the nearest and the farthest point.
"""

from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.image_matching import MatchedImages, image_folders
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, photographs_of, require_numbers
from fecocodec.errors import InputError
from fecocodec.input_file import read_file
from fecocodec.photographs.image_headers import has_image_name, maps_among
from fecocodec.photographs.lens import MAX_SIDE_PX, Lens

FILE_NAME = "poses_bounds.npy"
_COLUMNS = 17


def is_llff(path: Path) -> bool:
    return path.name.lower().endswith(FILE_NAME)


def find_llff(path: Path) -> Path | None:
    """Return the camera file of a scene folder, or `path` itself if it is one; None if there is none."""
    if path.is_file():
        return path if is_llff(path) else None
    return path / FILE_NAME if (path / FILE_NAME).is_file() else None


def read_llff(path: Path) -> PosedPhotographs:
    """Read the cameras. Raises InputError if the file is not valid, or no folder has as many images as it has cameras.

    A row that is not valid gives a camera with a problem. Bounds of depth are those of all rows.
    """
    rows = _rows(path)
    images = _images(path, len(rows))
    cameras = [(f"{path}, row {index}", partial(_photograph, row)) for index, row in enumerate(rows)]
    bounds = rows[:, 15:][np.isfinite(rows[:, 15:]).all(axis=1)]
    near, far = (float(bounds[:, 0].min()), float(bounds[:, 1].max())) if len(bounds) else (None, None)
    return PosedPhotographs(path, photographs_of(images, cameras), near, far, images.remarks)


def _rows(path: Path) -> Float[np.ndarray, "image 17"]:
    try:
        rows = np.load(BytesIO(read_file(path)), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(f"{path}: this is no array as NumPy writes it; export it again.") from error
    if not isinstance(rows, np.ndarray) or rows.dtype.kind not in "fiu" or rows.ndim != 2 or rows.shape[1] != _COLUMNS:
        raise InputError(f"{path}: an array of {_COLUMNS} numbers for each image is expected; export it again.")
    if not len(rows):
        raise InputError(f"{path}: no cameras; export it again.")
    return rows.astype(np.float64)


def _images(path: Path, count: int) -> MatchedImages:
    """Return the first folder with one image for each camera."""
    found = list[tuple[Path, list[Path]]]()
    for folder, _ in image_folders([path.parent / "images", path.parent]):
        images = {file for file in folder.iterdir() if has_image_name(file)} if folder.is_dir() else set[Path]()
        found.append((folder, sorted(images - maps_among(images))))
    fitting = next(((folder, files) for folder, files in found if len(files) == count), None)
    if fitting is None:
        sizes = ", ".join(f"{len(files)} in {folder}" for folder, files in found if files) or "none"
        raise InputError(
            f"{path}: has cameras for {count} images, but there are {sizes}; put exactly the images there that it was "
            "made from."
        )
    folder, files = fitting
    is_usual = folder in (path.parent / "images", path.parent)
    remarks = () if is_usual else (f"the images of {path.name} are taken from {folder.name}.",)
    return MatchedImages(tuple(file.name for file in files), tuple(files), 1, remarks)


def _photograph(row: Float[np.ndarray, "17"], image: Path, place: str) -> PosedPhotograph:
    matrix = require_numbers(row[:15], (15,), place).reshape(3, 5)
    down, right, backwards, position, (height, width, focal) = matrix.T
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and focal > 0):
        raise InputError(f"{place}: height, width and focal length are no camera's; export it again.")
    pose = np.eye(4)
    pose[:3] = np.stack((right, down, -backwards, position), axis=-1)
    size = round(float(width)), round(float(height))
    lens = Lens(*size, float(focal), float(focal), float(width) / 2, float(height) / 2)
    return PosedPhotograph(image, place, pose, partial(lens.scaled_to, place=place), declared_size=size)
