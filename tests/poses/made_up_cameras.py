"""Estimated cameras whose truth is known, and where they see points."""

import numpy as np

from fecocodec.photographs.lens import Lens, distort
from fecocodec.poses.estimated_cameras import EstimatedCamera

Position = tuple[float, float, float]


def camera(name: str, lens: Lens, position: Position = (0.0, 0.0, 0.0), turn: float = 0.0) -> EstimatedCamera:
    """A camera that is turned by `turn` degrees about the vertical axis."""
    angle, pose = np.radians(turn), np.eye(4)
    pose[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    pose[:3, 3] = position
    return EstimatedCamera(name, lens, pose, np.ones(1))


def pixels(of: EstimatedCamera, points: np.ndarray) -> np.ndarray:
    """Where the camera sees points of the world [n 3]."""
    local = (points - of.camera_to_world[:3, 3]) @ of.camera_to_world[:3, :3]
    return distort(of.lens, local[:, :2] / local[:, 2:]) * of.lens.fx + (of.lens.cx, of.lens.cy)
