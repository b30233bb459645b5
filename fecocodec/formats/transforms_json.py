"""Cameras in `transforms.json`, as nerfstudio and instant-ngp write it.

Poses are camera-to-world in OpenGL axes (+X right, +Y up, +Z backwards). A value in a frame wins over the same value
at the top level. Optional `near` and `far` at the top level bound the depth.
"""

import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.formats.lens import Lens
from fecocodec.formats.posed_photographs import PosedPhotograph, PosedPhotographs, find_image, require_numbers

_FILE_NAMES = ("transforms.json", "transforms_train.json")
_SUPPORTED_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_RADIAL_KEYS = ("k1", "k2", "k3", "k4")


def find_transforms_json(path: Path) -> Path | None:
    """The camera file in a scene folder; a `.json` file given itself is taken as one."""
    if path.is_file():
        return path if path.suffix.lower() == ".json" else None
    return next((path / name for name in _FILE_NAMES if (path / name).is_file()), None)


def read_transforms_json(path: Path) -> PosedPhotographs:
    """Read the cameras of every frame. Raises InputError where the file is broken or a camera is of no use."""
    scene = _load(path)
    frames = scene.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{path}: no frames; add a list `frames` with one camera per image.")
    photographs = [_photograph(path, scene, index, frame) for index, frame in enumerate(frames)]
    near, far = (_number(scene, key, str(path)) for key in ("near", "far"))
    return PosedPhotographs(path, photographs, near, far)


def _load(path: Path) -> dict[str, Any]:
    try:
        scene = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path.") from error
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}, line {error.lineno}, column {error.colno}: broken JSON ({error.msg}); mend or export it again."
        ) from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: this is not JSON text in UTF-8; export it again.") from error
    if not isinstance(scene, dict):
        raise InputError(f"{path}: the outermost value is not an object; export it again.")
    return scene


def _photograph(path: Path, scene: dict[str, Any], index: int, frame: object) -> PosedPhotograph:
    place = f"{path}, frame {index}"
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise InputError(f"{place}: no `file_path`; name the image of this camera.")
    place = f"{place} ({frame['file_path']})"
    values = scene | frame
    model = values.get("camera_model", "OPENCV")
    if model not in _SUPPORTED_MODELS or values.get("is_fisheye"):
        raise InputError(f"{place}: camera model {model} or fisheye is not supported; undistort the images first.")
    return PosedPhotograph(
        path=find_image(path.parent, frame["file_path"]),
        place=place,
        camera_to_world=_pose(frame.get("transform_matrix"), place) @ _OPENGL_TO_OPENCV,
        lens_for=partial(_lens, values, place),
    )


def _pose(matrix: object, place: str) -> Float[np.ndarray, "4 4"]:
    place = f"{place}, transform_matrix"
    if isinstance(matrix, list) and len(matrix) == 3:  # some exporters leave the constant last row out
        matrix = [*matrix, [0, 0, 0, 1]]
    return require_numbers(matrix, (4, 4), place)


def _lens(values: dict[str, Any], place: str, width: int, height: int) -> Lens:
    """The lens for an image stored at width x height; it may differ from the `w`, `h` the focal lengths are for."""
    get = partial(_number, values, place=place)
    w, h = get("w") or float(width), get("h") or float(height)
    if w < 1 or h < 1:
        raise InputError(f"{place}: w and h are not positive; give the image size in pixels.")
    fx = get("fl_x") or _focal_length(get("camera_angle_x"), w)
    fy = get("fl_y") or _focal_length(get("camera_angle_y"), h)
    fx, fy = fx or fy, fy or fx  # one focal length is for square pixels
    if fx is None or fy is None or fx <= 0 or fy <= 0:
        raise InputError(f"{place}: no positive focal length; give fl_x in pixels or camera_angle_x in radians.")
    cx, cy = get("cx"), get("cy")
    lens = Lens(
        width=round(w),
        height=round(h),
        fx=fx,
        fy=fy,
        cx=w / 2 if cx is None else cx,
        cy=h / 2 if cy is None else cy,
        radial=tuple(get(key) or 0.0 for key in _RADIAL_KEYS),
        tangential=(get("p1") or 0.0, get("p2") or 0.0),
    )
    return lens.scaled_to(width, height, place)


def _focal_length(angle: float | None, length: float) -> float | None:
    """Focal length in pixels of a field of view in radians across `length` pixels."""
    if angle is None or not 0 < angle < math.pi:
        return None
    return length / 2 / math.tan(angle / 2)


def _number(values: dict[str, Any], key: str, place: str) -> float | None:
    value = values.get(key)
    return None if value is None else float(require_numbers(value, (), f"{place}, {key}"))
