"""Cameras in `cameras.json`, the list that training with the 3DGS reference implementation writes.

Each camera has a position and a camera-to-world rotation in OpenCV axes, the size of its image, and focal lengths in
pixels; the principal point is the centre of the image (`camera_to_JSON` of the reference).
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, find_image, require_numbers
from fecocodec.errors import InputError
from fecocodec.photographs.lens import MAX_SIDE_PX, Lens


def read_reference_cameras(path: Path, cameras: list[Any]) -> PosedPhotographs:
    """Return the cameras of a file. cameras: what its JSON holds. Raises InputError if one is not valid."""
    if not cameras:
        raise InputError(f"{path}: no cameras; export it again.")
    return PosedPhotographs(path, [_photograph(path, index, camera) for index, camera in enumerate(cameras)])


def _photograph(path: Path, index: int, camera: object) -> PosedPhotograph:
    place = f"{path}, camera {index}"
    if not isinstance(camera, dict) or not isinstance(camera.get("img_name"), str):
        raise InputError(f"{place}: no `img_name`; name the image of this camera.")
    place = f"{place} ({camera['img_name']})"
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
    lens_for = partial(_scaled, lens, place)
    return PosedPhotograph(find_image(path.parent, camera["img_name"]), place, pose, lens_for, declared_size=size)


def _scaled(lens: Lens, place: str, width: int, height: int) -> Lens:
    return lens.scaled_to(width, height, place)
