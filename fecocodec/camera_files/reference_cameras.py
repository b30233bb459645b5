"""Cameras in `cameras.json`, the list that training with the 3DGS reference implementation writes.

Each camera has a position and a camera-to-world rotation in OpenCV axes, the size of its image, and focal lengths in
pixels; the principal point is the centre of the image (`camera_to_JSON` of the reference). Images are named with or
without suffix, and lie beside the file or in `images`.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.camera_files.image_matching import match_images
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, photographs_of, require_numbers
from fecocodec.errors import InputError
from fecocodec.photographs.lens import MAX_SIDE_PX, Lens


def is_reference_cameras(cameras: object) -> bool:
    """Return whether what a JSON file holds is such a list."""
    return isinstance(cameras, list) and any(isinstance(camera, dict) and "img_name" in camera for camera in cameras)


def read_reference_cameras(path: Path, cameras: list[Any]) -> PosedPhotographs:
    """Return the cameras of a file, from its JSON; invalid ones have a problem. Raises InputError for an empty list."""
    if not cameras:
        raise InputError(f"{path}: no cameras; export it again.")
    if not is_reference_cameras(cameras):
        raise InputError(
            f"{path}: a list without `img_name`, as `ns-export cameras` writes it, which has no lenses; give the "
            "transforms.json of the photographs."
        )
    names = [_name(camera) for camera in cameras]
    images = match_images(path, names, [path.parent, path.parent / "images"])
    readers = [
        (f"{path}, camera {index}" + (f" ({name})" if name else ""), partial(_photograph, camera))
        for index, (name, camera) in enumerate(zip(names, cameras, strict=True))
    ]
    return PosedPhotographs(path, photographs_of(images, readers), remarks=images.remarks)


def _name(camera: object) -> str:
    name = camera.get("img_name") if isinstance(camera, dict) else None
    return name if isinstance(name, str) else ""


def _photograph(camera: object, image: Path, place: str) -> PosedPhotograph:
    if not isinstance(camera, dict) or not _name(camera):
        raise InputError(f"{place}: no `img_name`; name the image of this camera.")
    pose = np.eye(4)
    pose[:3, :3] = require_numbers(camera.get("rotation"), (3, 3), f"{place}, rotation")
    pose[:3, 3] = require_numbers(camera.get("position"), (3,), f"{place}, position")
    keys = ("width", "height", "fx", "fy")
    width, height, fx, fy = require_numbers([camera.get(key) for key in keys], (4,), f"{place}, {', '.join(keys)}")
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX):
        raise InputError(f"{place}: width and height are no size of an image; give the image size in pixels.")
    if min(fx, fy) <= 0.0:
        raise InputError(f"{place}: no positive focal length; give fx and fy in pixels.")
    size = round(float(width)), round(float(height))
    lens = Lens(*size, float(fx), float(fy), float(width) / 2, float(height) / 2)
    return PosedPhotograph(image, place, pose, partial(lens.scaled_to, place=place), declared_size=size)
