"""Cameras in `transforms.json`, the format of nerfstudio and instant-ngp.

Poses are camera-to-world in OpenGL axes (+X right, +Y up, +Z backwards). A value in a frame takes precedence over the
same value at the top level; `null` is no value. Optional `near` and `far` at the top level are bounds of depth in scene
units. `distortion_params` of nerfstudio are k1 k2 k3 k4 p1 p2.
"""

import math
import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.image_matching import MatchedImages, match_images
from fecocodec.camera_files.posed_photographs import (
    PosedPhotograph,
    PosedPhotographs,
    photographs_of,
    require_numbers,
)
from fecocodec.camera_files.reference_cameras import is_reference_cameras, read_reference_cameras
from fecocodec.errors import InputError
from fecocodec.input_file import read_json
from fecocodec.photographs.lens import (
    ASPECT_TOLERANCE,
    MAX_SIDE_PX,
    Lens,
    lens_of_model,
    require_known_model,
)

FILE_NAMES = ("transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json")
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_DISTORTION_PARAMS = ("k1", "k2", "k3", "k4", "p1", "p2")
_NUMBERS = (
    *("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y"),
    *(*_DISTORTION_PARAMS, "k5", "k6"),
)
_MODELS_OF_KEYS = {  # of instant-ngp
    "is_fisheye": "OPENCV_FISHEYE",
    "latlong": "EQUIRECTANGULAR",
    "equirectangular": "EQUIRECTANGULAR",
    "ftheta_p0": "FTHETA",
}


def find_transforms_json(path: Path) -> Path | None:
    """Return the camera file of a scene folder, or `path` itself if it is a `.json` file; None if there is none."""
    if path.is_file():
        return path if path.suffix.lower() == ".json" else None
    # Also a pipe, a folder or a broken link of that name, which reading then reports.
    return next((path / name for name in FILE_NAMES if os.path.lexists(path / name)), None)


def find_cameras_json(path: Path) -> Path | None:
    """Return `cameras.json` of a scene folder if it is of 3DGS or, as `--save-cameras` writes it, has frames."""
    found = path / "cameras.json"
    return found if found.is_file() and holds_cameras(found) else None


def holds_cameras(path: Path) -> bool:
    """Return whether a JSON file has frames, or is of 3DGS; any name will do."""
    try:
        scene = read_json(path)
    except InputError:
        return False
    frames = scene.get("frames") if isinstance(scene, dict) else None
    has_poses = isinstance(frames, list) and any(isinstance(one, dict) and "transform_matrix" in one for one in frames)
    return has_poses or is_reference_cameras(scene)


def read_transforms_json(path: Path) -> PosedPhotographs:
    """Read the cameras of all frames; a list is read as `cameras.json` of the 3DGS reference.

    Raises InputError if the file is not valid. A frame that is not valid has a problem.
    """
    scene = read_json(path)
    if isinstance(scene, list):
        return read_reference_cameras(path, scene)
    if not isinstance(scene, dict):
        raise InputError(f"{path}: the outermost value is not an object; export it again.")
    frames = scene.get("frames")
    if not isinstance(frames, list) or not frames:
        what = 'no list "frames", but an object of this name' if isinstance(frames, dict) and frames else "no frames"
        raise InputError(f'{path}: {what}; add a list "frames" with one camera per image.')
    images = match_images(path, [_name(frame) for frame in frames], [path.parent])
    places = [
        f"{path}, frame {index}" + (f" ({_name(frame)})" if _is_named(frame) else "")
        for index, frame in enumerate(frames)
    ]
    cameras = [
        (place, partial(_photograph, mask, scene, frame, images.reduction))
        for place, frame, mask in zip(places, frames, _masks(path, frames, images), strict=True)
    ]
    near, far = (None if scene.get(key) is None else _number(scene, key, str(path)) for key in ("near", "far"))
    return PosedPhotographs(path, photographs_of(images, cameras), near, far, images.remarks)


def _masks(path: Path, frames: list[Any], images: MatchedImages) -> list[Path | None]:
    """Return the masks that frames name, found as images are, but never a photograph in place of a mask.

    That of reduced photographs is taken (`masks_2`) if there is only that one.
    """
    names = [_name(frame, "mask_path") for frame in frames]
    if not any(names):
        return [None] * len(names)
    found = match_images(path, names, [path.parent]).paths
    masks = list[Path | None]()
    for name, mask in zip(names, found, strict=True):
        named = path.parent / name.replace("\\", "/") if mask in images.paths else mask
        reduced = named.parent.parent / f"{named.parent.name}_{images.reduction}" / named.name
        is_reduced = os.path.isfile(reduced) and not os.path.isfile(named)
        masks.append((reduced if is_reduced else named) if name else None)
    return masks


def _name(frame: object, key: str = "file_path") -> str:
    name = frame.get(key) if isinstance(frame, dict) else None
    return name if isinstance(name, str) else ""


def _is_named(frame: object) -> bool:
    return isinstance(frame, dict) and isinstance(frame.get("file_path"), str)


def _photograph(
    mask: Path | None, scene: dict[str, Any], frame: object, reduction: int, image: Path, place: str
) -> PosedPhotograph:
    if not isinstance(frame, dict) or not _is_named(frame):
        raise InputError(f"{place}: no `file_path`; name the image of this camera.")
    if not isinstance(frame.get("mask_path", ""), str | None):
        raise InputError(f"{place}: `mask_path` is not text; name the mask of this image, or leave it out.")
    model = _model(_stated(scene) | _stated(frame), place)
    values = _with_coefficients(scene, place) | _with_coefficients(frame, place)
    numbers = {key: _number(values, key, place) for key in _NUMBERS if key in values}
    if min(_focal_lengths(numbers, 1.0, 1.0) or (0.0,)) <= 0:
        raise InputError(f"{place}: no positive focal length; give fl_x in pixels or camera_angle_x in radians.")
    return PosedPhotograph(
        path=image,
        place=place,
        camera_to_world=_pose(values.get("transform_matrix"), place) @ OPENGL_TO_OPENCV,
        lens_for=partial(_lens, model, numbers, reduction, place),
        declared_size=_declared_size(numbers),
        mask=mask,
    )


def _stated(part: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in part.items() if value is not None}


def _with_coefficients(part: dict[str, Any], place: str) -> dict[str, Any]:
    """Return the values of a frame or of the top level, with `distortion_params` as k1 to p2."""
    values = _stated(part)
    if "distortion_params" not in values:
        return values
    parameters = require_numbers(values["distortion_params"], (6,), f"{place}, distortion_params")
    return values | dict(zip(_DISTORTION_PARAMS, parameters.tolist(), strict=True))


def _model(values: dict[str, Any], place: str) -> str:
    """Return one of CAMERA_MODELS. Raises InputError for another camera model."""
    stated = str(values.get("camera_model", "OPENCV")).upper()
    stated = next((model for key, model in _MODELS_OF_KEYS.items() if values.get(key)), stated)
    model = "OPENCV" if stated == "PERSPECTIVE" else stated
    require_known_model(model, place)
    return model


def _declared_size(numbers: dict[str, float]) -> tuple[int, int] | None:
    """Return (`w`, `h`) in pixels, None if one is missing or is no size of an image."""
    w, h = numbers.get("w", 0.0), numbers.get("h", 0.0)
    return (round(w), round(h)) if 1 <= w <= MAX_SIDE_PX and 1 <= h <= MAX_SIDE_PX else None


def _pose(matrix: object, place: str) -> Float[np.ndarray, "4 4"]:
    if matrix is None:
        raise InputError(f"{place}: no `transform_matrix`; add the pose of its camera, or remove the frame.")
    place = f"{place}, transform_matrix"
    if isinstance(matrix, list) and len(matrix) == 3:  # some exporters omit the constant last row
        matrix = [*matrix, [0, 0, 0, 1]]
    return require_numbers(matrix, (4, 4), place)


def _lens(model: str, numbers: dict[str, float], reduction: int, place: str, width: int, height: int) -> Lens:
    """Return the lens for a stored image of this size in pixels, which may differ from the calibrated size.

    The calibrated size is (`w`, `h`). If missing, it is derived from `fl_x` and `camera_angle_x`; if one of these is
    also missing, it is the size of the image times the reduction of its folder.
    """
    scale = _implied_scale(numbers, width, reduction)
    w, h = numbers.get("w") or scale * width, numbers.get("h") or scale * height
    if not (1 <= w <= MAX_SIDE_PX and 1 <= h <= MAX_SIDE_PX):
        raise InputError(f"{place}: w and h are no size of an image; give the image size in pixels.")
    focal = _focal_lengths(numbers, w, h)
    assert focal is not None  # `_numbers` has refused a lens without one
    if "w" not in numbers and "h" not in numbers and reduction == 1:
        _require_central(numbers.get("cx"), numbers.get("cy"), w, h, place)
    centre = {"cx": numbers.get("cx", w / 2), "cy": numbers.get("cy", h / 2)}
    lens = lens_of_model(model, (round(w), round(h)), numbers | {"fx": focal[0], "fy": focal[1]} | centre)
    return lens.scaled_to(width, height, place)


def _implied_scale(numbers: dict[str, float], width: int, reduction: int) -> float:
    """Return the ratio of the width implied by `fl_x` and `camera_angle_x` to the stored width."""
    focal, angle = numbers.get("fl_x"), numbers.get("camera_angle_x")
    if focal is None or angle is None or not 0 < angle < math.pi:
        return float(reduction)
    scale = 2 * focal * math.tan(angle / 2) / width
    return scale if abs(scale - 1) > ASPECT_TOLERANCE else 1.0


def _require_central(cx: float | None, cy: float | None, width: float, height: float, place: str) -> None:
    """Raise InputError if the principal point is outside the middle half of the image, a sign of another image size."""
    if cx is None or cy is None:
        return
    if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > 0.25:
        raise InputError(
            f"{place}: fl_x, cx and cy are in pixels of an image of about {2 * cx:.0f}x{2 * cy:.0f}, but the image is "
            f"{width:.0f}x{height:.0f}; add w and h, the image size that they are for."
        )


def _focal_lengths(numbers: dict[str, float], w: float, h: float) -> tuple[float, float] | None:
    """Return (fx, fy) in pixels; one focal length is for square pixels. None if there is none."""
    fx = numbers.get("fl_x") or _focal_length(numbers.get("camera_angle_x"), w)
    fy = numbers.get("fl_y") or _focal_length(numbers.get("camera_angle_y"), h)
    fx, fy = fx or fy, fy or fx
    return None if fx is None or fy is None else (fx, fy)


def _focal_length(angle: float | None, length: float) -> float | None:
    """Return the focal length in pixels for a field of view in radians across `length` pixels."""
    if angle is None or not 0 < angle < math.pi:
        return None
    return length / 2 / math.tan(angle / 2)


def _number(values: dict[str, Any], key: str, place: str) -> float:
    return float(require_numbers(values[key], (), f"{place}, {key}"))
