"""Cameras in `transforms.json`, the format of nerfstudio and instant-ngp.

Poses are camera-to-world in OpenGL axes (+X right, +Y up, +Z backwards). A value in a frame takes precedence over the
same value at the top level. Optional `near` and `far` at the top level are bounds of depth in scene units.
"""

import math
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, find_image, require_numbers
from fecocodec.camera_files.reference_cameras import read_reference_cameras
from fecocodec.errors import InputError
from fecocodec.input_file import read_json
from fecocodec.photographs.lens import ASPECT_TOLERANCE, MAX_SIDE_PX, Lens

_FILE_NAMES = ("transforms.json", "transforms_train.json")
_SUPPORTED_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_RADIAL_KEYS = ("k1", "k2", "k3", "k4")


def find_transforms_json(path: Path) -> Path | None:
    """Return the camera file of a scene folder, or `path` itself if it is a `.json` file; None if there is none."""
    if path.is_file():
        return path if path.suffix.lower() == ".json" else None
    # Also a pipe, a folder or a broken link of that name, which reading then reports.
    return next((path / name for name in _FILE_NAMES if os.path.lexists(path / name)), None)


def read_transforms_json(path: Path) -> PosedPhotographs:
    """Read the cameras of all frames; a list is read as `cameras.json` of the 3DGS reference.

    Raises InputError if the file or a camera is not valid.
    """
    scene = read_json(path)
    if isinstance(scene, list):
        return read_reference_cameras(path, scene)
    if not isinstance(scene, dict):
        raise InputError(f"{path}: the outermost value is not an object; export it again.")
    frames = scene.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{path}: no frames; add a list `frames` with one camera per image.")
    photographs = [_photograph(path, scene, index, frame) for index, frame in enumerate(frames)]
    _require_one_camera_each(photographs)
    near, far = (_number(scene, key, str(path)) for key in ("near", "far"))
    return PosedPhotographs(path, photographs, near, far)


def _require_one_camera_each(photographs: list[PosedPhotograph]) -> None:
    """Raise InputError if two frames name one image."""
    places: dict[Path, str] = {}
    for photograph in photographs:
        if photograph.path in places:
            raise InputError(
                f"{photograph.place}: another frame has this image, too ({places[photograph.path]}); remove one."
            )
        places[photograph.path] = photograph.place


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
        camera_to_world=_pose(frame.get("transform_matrix"), place) @ OPENGL_TO_OPENCV,
        lens_for=partial(_lens, values, place),
        declared_size=_declared_size(values, place),
    )


def _declared_size(values: dict[str, Any], place: str) -> tuple[int, int] | None:
    """Return (`w`, `h`) in pixels, None if one is missing or is no size of an image."""
    w, h = (_number(values, key, place) for key in ("w", "h"))
    if w is None or h is None or not (1 <= w <= MAX_SIDE_PX and 1 <= h <= MAX_SIDE_PX):
        return None
    return round(w), round(h)


def _pose(matrix: object, place: str) -> Float[np.ndarray, "4 4"]:
    if matrix is None:
        raise InputError(f"{place}: no `transform_matrix`; add the pose of its camera, or remove the frame.")
    place = f"{place}, transform_matrix"
    if isinstance(matrix, list) and len(matrix) == 3:  # some exporters omit the constant last row
        matrix = [*matrix, [0, 0, 0, 1]]
    return require_numbers(matrix, (4, 4), place)


def _lens(values: dict[str, Any], place: str, width: int, height: int) -> Lens:
    """Return the lens for a stored image of this size in pixels, which may differ from the calibrated size.

    The calibrated size is (`w`, `h`). If missing, it is derived from `fl_x` and `camera_angle_x`; if one of these is
    also missing, it is the size of the image.
    """
    get = partial(_number, values, place=place)
    scale = _implied_scale(get, width)
    w, h = get("w") or scale * width, get("h") or scale * height
    if not (1 <= w <= MAX_SIDE_PX and 1 <= h <= MAX_SIDE_PX):
        raise InputError(f"{place}: w and h are no size of an image; give the image size in pixels.")
    fx = get("fl_x") or _focal_length(get("camera_angle_x"), w)
    fy = get("fl_y") or _focal_length(get("camera_angle_y"), h)
    fx, fy = fx or fy, fy or fx  # one focal length is for square pixels
    if fx is None or fy is None or fx <= 0 or fy <= 0:
        raise InputError(f"{place}: no positive focal length; give fl_x in pixels or camera_angle_x in radians.")
    cx, cy = get("cx"), get("cy")
    if get("w") is None and get("h") is None:
        _require_central(cx, cy, width, height, place)
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


def _implied_scale(get: Callable[[str], float | None], width: int) -> float:
    """Return the ratio of the width implied by `fl_x` and `camera_angle_x` to the stored width; 1 if one is missing."""
    focal, angle = get("fl_x"), get("camera_angle_x")
    if focal is None or angle is None or not 0 < angle < math.pi:
        return 1.0
    scale = 2 * focal * math.tan(angle / 2) / width
    return scale if abs(scale - 1) > ASPECT_TOLERANCE else 1.0


def _require_central(cx: float | None, cy: float | None, width: int, height: int, place: str) -> None:
    """Raise InputError if the principal point is outside the middle half of the image, a sign of another image size."""
    if cx is None or cy is None:
        return
    if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > 0.25:
        raise InputError(
            f"{place}: fl_x, cx and cy are in pixels of an image of about {2 * cx:.0f}x{2 * cy:.0f}, but the image is "
            f"{width}x{height}; add w and h, the image size that they are for."
        )


def _focal_length(angle: float | None, length: float) -> float | None:
    """Return the focal length in pixels for a field of view in radians across `length` pixels."""
    if angle is None or not 0 < angle < math.pi:
        return None
    return length / 2 / math.tan(angle / 2)


def _number(values: dict[str, Any], key: str, place: str) -> float | None:
    value = values.get(key)
    return None if value is None else float(require_numbers(value, (), f"{place}, {key}"))
