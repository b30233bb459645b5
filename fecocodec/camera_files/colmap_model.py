"""The tables of a COLMAP sparse model, binary or text."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class ColmapCamera:
    """A camera. model: COLMAP's name, such as OPENCV. parameters: in pixels, in COLMAP's order for this model."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """An image. rotation (quaternion wxyz), translation: world-to-camera, OpenCV axes. point_ids: -1 for no point."""

    name: str
    camera_id: int
    rotation: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]
    point_ids: Int[np.ndarray, " observation"]


@dataclass(frozen=True)
class ColmapModel:
    """Cameras by id, images in stored order, positions of points by id (empty if the model has no points table)."""

    cameras: dict[int, ColmapCamera]
    images: list[ColmapImage]
    points: dict[int, tuple[float, float, float]]
