"""Which of several estimates of the same cameras is right.

The reprojection error does not tell: it counts only the matches that an estimate explains. Here all estimates are
judged by the same matches, those between the photographs that they have in common.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.photographs.lens import Lens, distort
from fecocodec.poses.estimated_cameras import EstimatedCamera, pose_difference
from fecocodec.poses.likely_pairs import Pair
from fecocodec.poses.turned_camera import Points
from fecocodec.poses.two_view_fit import LOSS_SCALE_PX, TwoViewMatches

_MOST_MATCHES = 200  # of a pair, evenly chosen
_UNDISTORTION_STEPS = 20

MatchedPoints = Mapping[Pair, tuple[Points, Points]]
Errors = Float[np.ndarray, " _"]


@dataclass(frozen=True)
class Estimate:
    """Registered cameras in the order of their names. model: the reconstruction of pycolmap."""

    cameras: tuple[EstimatedCamera, ...]
    model: Any

    @property
    def names(self) -> frozenset[str]:
        return frozenset(camera.name for camera in self.cameras)


def best_estimate(estimates: list[Estimate], points: MatchedPoints) -> Estimate:
    """Return the estimate of the most photographs; of several, the one that explains the matches best; else the first.

    points: matched points of pairs of photographs, in pixels.
    """
    best, *rest = estimates
    for other in rest:
        common = best.names & other.names
        more = len(other.cameras) - len(best.cameras)
        if more > 0 or (more == 0 and match_cost(other, common, points) < match_cost(best, common, points)):
            best = other
    return best


def least_difference(best: Estimate, estimates: list[Estimate]) -> tuple[float, float] | None:
    """Return the smallest difference of an estimate from the others; see `Reconstruction.difference`."""
    differences = [pose_difference(best.cameras, other.cameras) for other in estimates if other is not best]
    return min((one for one in differences if one is not None), key=sum, default=None)


def match_cost(estimate: Estimate, names: frozenset[str], points: MatchedPoints) -> float:
    """Return the mean of log(1 + (e / s)^2) over the matches between photographs of these names; 0 without matches.

    e: error of a match in pixels. s: LOSS_SCALE_PX.
    """
    cameras = tuple(camera for camera in estimate.cameras if camera.name in names)
    errors = np.concatenate([np.zeros(0), *match_errors(cameras, points).values()])
    return float(np.log1p((errors / LOSS_SCALE_PX) ** 2).sum() / max(1, len(errors)))


def match_errors(cameras: tuple[EstimatedCamera, ...], points: MatchedPoints) -> dict[Pair, Errors]:
    """Return the errors in pixels of at most _MOST_MATCHES matches of each pair of these cameras.

    Sampson distances; for points behind a camera, their error at infinity.
    """
    camera_of = {camera.name: camera for camera in cameras}
    errors = {}
    for pair, matched in points.items():
        if len(matched[0]) and all(name in camera_of for name in pair):
            chosen = np.linspace(0, len(matched[0]) - 1, min(len(matched[0]), _MOST_MATCHES)).round().astype(int)
            first, second = (camera_of[name] for name in pair)
            errors[pair] = _pair_errors((first, second), (matched[0][chosen], matched[1][chosen]))
    return errors


def _pair_errors(cameras: tuple[EstimatedCamera, EstimatedCamera], points: tuple[Points, Points]) -> Errors:
    first, second = (_undistorted(camera.lens, seen) for camera, seen in zip(cameras, points, strict=True))
    pose = np.linalg.inv(cameras[1].camera_to_world) @ cameras[0].camera_to_world
    direction = pose[:3, 3] / max(1e-12, float(np.linalg.norm(pose[:3, 3])))
    matches = TwoViewMatches(first, second, (cameras[0].lens.fx, cameras[1].lens.fx), prior=0.0)
    return matches.errors_in_front_px(pose[:3, :3], direction, 1.0)


def _undistorted(lens: Lens, points: Points) -> Points:
    """Return the points without distortion, in pixels from the principal point. Distortion without inverse is kept."""
    seen = (points - (lens.cx, lens.cy)) / lens.fx
    plane = seen
    for _ in range(_UNDISTORTION_STEPS):
        plane = np.clip(plane + seen - distort(lens, plane), -10.0, 10.0)
    result: Points = plane * lens.fx
    return result
