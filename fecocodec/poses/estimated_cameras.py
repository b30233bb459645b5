"""Cameras that were estimated from photographs, and how two estimates differ."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.photographs.lens import Lens

_LEAST_BASELINE = 0.3  # of the longest one; directions of shorter ones are not compared


@dataclass(frozen=True)
class ImageGroup:
    """Photographs of one size, taken to share their lens. focal_px: initial focal length in pixels.

    is_known: whether the focal length comes from EXIF data. It is refined in both cases. is_fixed: whether the user
    gave it; it is then not refined.
    """

    names: tuple[str, ...]
    focal_px: float
    is_known: bool
    is_fixed: bool = False


@dataclass(frozen=True)
class EstimatedCamera:
    """The camera of one registered photograph. camera_to_world: OpenCV axes, in the frame of the first camera.

    depths: of the reconstructed points that it observes, in the unit of the reconstruction.
    """

    name: str
    lens: Lens
    camera_to_world: Float[np.ndarray, "4 4"]
    depths: Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Ambiguity:
    """How far the fits of two views that explain the matches nearly as well differ from the best one.

    zooms: smallest and largest focal length, relative to the estimate. direction: of the baseline, in degrees.
    """

    zooms: tuple[float, float]
    direction: float


@dataclass(frozen=True)
class Reconstruction:
    """Registered cameras in the order of their names, and the quality of the reconstruction.

    reprojection_error_px: mean over observations. angle: median angle in degrees between the rays of a point.
    matches: number of verified matches of each pair of photographs (names in order). difference: of the rotations and
    directions between cameras, in degrees, from the nearest other estimate, which starts from another focal length; see
    `pose_difference`. It is None if all others lack a camera, and for two photographs. ambiguity: of two photographs;
    None for more. is_turned: whether the camera only turned; nothing is then estimated. reached: number of features
    that match a reconstructed point, of each photograph without a camera that has any. explained: the smallest share of
    the matches between two parts of the photographs that the cameras explain.
    """

    cameras: tuple[EstimatedCamera, ...]
    reprojection_error_px: float
    angle: float
    matches: dict[tuple[str, str], int]
    difference: tuple[float, float] | None
    ambiguity: Ambiguity | None = None
    is_turned: bool = False
    reached: dict[str, int] = field(default_factory=dict)
    explained: float = 1.0


def pose_difference(
    first: tuple[EstimatedCamera, ...], second: tuple[EstimatedCamera, ...]
) -> tuple[float, float] | None:
    """Return the largest differences of the rotation and direction between two cameras, over all pairs, in degrees.

    Directions between cameras that are close to each other are ignored, as they are uncertain. None if a camera of
    the first estimate is missing in the second.
    """
    poses = {camera.name: camera.camera_to_world for camera in second}
    if any(camera.name not in poses for camera in first):
        return None
    pairs = [(one, other) for index, one in enumerate(first) for other in first[:index]]
    known = [np.linalg.inv(one.camera_to_world) @ other.camera_to_world for one, other in pairs]
    found = [np.linalg.inv(poses[one.name]) @ poses[other.name] for one, other in pairs]
    rotation = max(rotation_angle(a[:3, :3].T @ b[:3, :3]) for a, b in zip(known, found, strict=True))
    longest = max(np.linalg.norm(pose[:3, 3]) for pose in known)
    direction = max(
        angle_between(a[:3, 3], b[:3, 3])
        for a, b in zip(known, found, strict=True)
        if np.linalg.norm(a[:3, 3]) > _LEAST_BASELINE * longest
    )
    return rotation, direction


def rotation_angle(rotation: Float[np.ndarray, "3 3"]) -> float:
    """Return the angle of a rotation in degrees."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def angle_between(first: Float[np.ndarray, " 3"], second: Float[np.ndarray, " 3"]) -> float:
    """Return the angle between two vectors in degrees."""
    cosine = first @ second / max(1e-12, float(np.linalg.norm(first) * np.linalg.norm(second)))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def cameras_of(model: Any) -> tuple[EstimatedCamera, ...]:
    """Return the registered cameras, in the frame of the first one."""
    images = sorted((model.image(image_id) for image_id in model.reg_image_ids()), key=lambda image: image.name)
    points = {point_id: point.xyz for point_id, point in model.points3D.items()}
    world_to_first = _matrix(images[0])
    cameras = []
    for image in images:
        world_to_camera = _matrix(image)
        seen = [points[point.point3D_id] for point in image.points2D if point.has_point3D()]
        depths = np.array(seen).reshape(-1, 3) @ world_to_camera[2, :3] + world_to_camera[2, 3]
        pose = world_to_first @ np.linalg.inv(world_to_camera)
        cameras.append(EstimatedCamera(image.name, _lens(model.camera(image.camera_id)), pose, depths[depths > 0]))
    return tuple(cameras)


def _matrix(image: Any) -> Float[np.ndarray, "4 4"]:
    """Return the world-to-camera matrix."""
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().matrix()
    return pose


def _lens(camera: Any) -> Lens:
    """Convert SIMPLE_PINHOLE (f, cx, cy) or SIMPLE_RADIAL (f, cx, cy, k)."""
    focal, cx, cy, *radial = map(float, camera.params)
    return Lens(camera.width, camera.height, focal, focal, cx, cy, tuple(radial))


def median_angle(model: Any) -> float:
    """Return the median over points of the largest angle, in degrees, between the rays to cameras that observe it."""
    centres = {image_id: model.image(image_id).projection_center() for image_id in model.reg_image_ids()}
    angles = []
    for point in model.points3D.values():
        observers = {element.image_id for element in point.track.elements}
        rays = np.array([centres[image_id] - point.xyz for image_id in observers])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1))))
    return float(np.median(angles)) if angles else 0.0
