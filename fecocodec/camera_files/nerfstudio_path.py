"""Camera paths of nerfstudio's viewer (JSON with `camera_path`): the cameras of a video, without photographs.

Poses are camera-to-world in OpenGL axes, 16 numbers row by row; `fov` is the vertical field of view in degrees. Layout:
nerfstudio, `nerfstudio/cameras/camera_paths.py`, `get_path_from_json`.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, require_numbers
from fecocodec.camera_files.transforms_json import OPENGL_TO_OPENCV
from fecocodec.errors import InputError
from fecocodec.input_file import read_json
from fecocodec.photographs.lens import Lens


def read_camera_path(path: Path) -> tuple[PosedPhotographs, float | None] | None:
    """Return the cameras of a camera path and its frames per second (None if not stated).

    The cameras have no images. Returns None if the JSON file is not a camera path. Raises InputError if it is not valid
    JSON, or a camera is not valid.
    """
    scene = read_json(path)
    if not isinstance(scene, dict) or "camera_path" not in scene:
        return None
    frames = scene["camera_path"]
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{path}: the camera path has no cameras; add keyframes and export it again.")
    kind = scene.get("camera_type", "perspective")
    if kind != "perspective":
        raise InputError(f"{path}: cameras of type {kind!r} are not supported; export a perspective camera path.")
    size = _size(scene, path)
    photographs = [_camera(path, index, frame, size, len(frames)) for index, frame in enumerate(frames)]
    return PosedPhotographs(path, photographs), _frames_per_second(scene, path)


def _camera(path: Path, index: int, frame: object, size: tuple[int, int], count: int) -> PosedPhotograph:
    place = f"{path}, camera {index}"
    if not isinstance(frame, dict):
        raise InputError(f"{place}: this is not an object; export the camera path again.")
    values = np.array(frame.get("camera_to_world") or [], dtype=object).ravel().tolist()  # 16 numbers, or 4 rows of 4
    pose = require_numbers(values, (16,), f"{place}, camera_to_world")
    fov = float(require_numbers(frame.get("fov"), (), f"{place}, fov"))
    if not 0 < fov < 180:
        raise InputError(f"{place}: a field of view of {fov:g} degrees is not possible; export the camera path again.")
    return PosedPhotograph(
        path=Path(f"{index:0{len(str(count - 1))}d}"),
        place=place,
        camera_to_world=pose.reshape(4, 4) @ OPENGL_TO_OPENCV,
        lens_for=partial(_lens, math.radians(fov)),
        declared_size=size,
    )


def _lens(fov: float, width: int, height: int) -> Lens:
    focal = height / 2 / math.tan(fov / 2)
    return Lens(width, height, focal, focal, width / 2, height / 2)


def _size(scene: dict[str, Any], path: Path) -> tuple[int, int]:
    """Return (width, height) of the frames in pixels."""
    width, height = (
        float(require_numbers(scene.get(key), (), f"{path}, {key}")) for key in ("render_width", "render_height")
    )
    if not (1 <= width <= 10**6 and 1 <= height <= 10**6):
        raise InputError(f"{path}: render_width and render_height are no size of an image; export the path again.")
    return round(width), round(height)


def _frames_per_second(scene: dict[str, Any], path: Path) -> float | None:
    if scene.get("fps") is None:
        return None
    value = float(require_numbers(scene["fps"], (), f"{path}, fps"))
    return value if 1 <= value <= 240 else None
