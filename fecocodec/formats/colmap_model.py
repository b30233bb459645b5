"""The tables of a COLMAP sparse model, whichever way they are stored."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class ColmapCamera:
    """model: COLMAP's name, such as OPENCV. parameters: in COLMAP's order for that model, pixels."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """rotation (quaternion wxyz) and translation: world-to-camera, OpenCV axes. point_ids: -1 where none."""

    name: str
    camera_id: int
    rotation: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]
    point_ids: Int[np.ndarray, " observation"]


@dataclass(frozen=True)
class ColmapModel:
    """Cameras by id, images in the order stored, positions of the points by id (empty where there is no such table)."""

    cameras: dict[int, ColmapCamera]
    images: list[ColmapImage]
    points: dict[int, tuple[float, float, float]]
