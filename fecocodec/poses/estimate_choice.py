"""Which of several estimates of the same cameras is right, and which parts of it hang on few matches.

The reprojection error does not tell: it counts only the matches that an estimate explains. Here all estimates are
judged by the same matches, those between the photographs that they have in common.

Repeated facades match each other. A photograph of one that is placed at another has a few matches that fit, and what
is registered after it fits it. The other matches between both parts contradict.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fecocodec.photographs.lens import Lens, distort
from fecocodec.poses.estimated_cameras import EstimatedCamera, cameras_of, pose_difference
from fecocodec.poses.likely_pairs import Pair
from fecocodec.poses.two_view_fit import LOSS_SCALE_PX, Points, TwoViewMatches

_MOST_MATCHES = 200  # of a pair, evenly chosen
_UNDISTORTION_STEPS = 20

MatchedPoints = Mapping[Pair, tuple[Points, Points]]
Errors = Float[np.ndarray, " _"]
_EXPLAINED_PX = 4.0  # as in the reconstruction
LEAST_SHARE = 0.75  # of the matches between two parts; chosen on 33 training and validation captures, as the next is
_STRONG_LINK = 60  # explained matches of a pair of photographs that join two parts in any case
_NO_LINK = 1e-6  # explained matches of a pair without any
Counts = Float[np.ndarray, "camera camera"]
Part = Bool[np.ndarray, " camera"]


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


def cut_weak_links(model: Any, points: MatchedPoints) -> bool:
    """Deregister the smaller parts of a reconstruction that its matches do not join to the largest.

    Returns whether there are any. Cameras before the last bundle adjustment explain too few matches to tell.
    """
    kept = joined_names(cameras_of(model), points)
    images = [model.image(image_id) for image_id in model.reg_image_ids()]
    for image in images:
        if image.name not in kept:
            model.deregister_frame(image.frame_id)
    return len(kept) < len(images)


def joined_names(cameras: tuple[EstimatedCamera, ...], points: MatchedPoints) -> frozenset[str]:
    """Return the photographs that are left when weakly joined parts are cut off. points: as for `best_estimate`."""
    names = [camera.name for camera in cameras]
    explained, total = _counts(cameras, points)
    kept = np.arange(len(names))
    while len(kept) > 2:
        within = np.ix_(kept, kept)
        cuts = _cuts(explained[within], total[within])
        weak = [part for share, link, part in cuts if share < LEAST_SHARE and link < _STRONG_LINK]
        if not weak:
            break
        kept = kept[~weak[0]]
    return frozenset(names[index] for index in kept)


def least_explained(cameras: tuple[EstimatedCamera, ...], points: MatchedPoints) -> float:
    """Return the smallest share of matches between two parts of the photographs that the cameras explain."""
    return min((share for share, _, _ in _cuts(*_counts(cameras, points))), default=1.0)


def _counts(cameras: tuple[EstimatedCamera, ...], points: MatchedPoints) -> tuple[Counts, Counts]:
    """Return the numbers of explained and of all matches of each pair of photographs."""
    index_of = {camera.name: index for index, camera in enumerate(cameras)}
    explained, total = np.zeros((2, len(cameras), len(cameras)))
    for (first, second), errors in match_errors(cameras, points).items():
        pair = index_of[first], index_of[second]
        total[pair] = total[pair[::-1]] = len(points[first, second][0])
        explained[pair] = explained[pair[::-1]] = total[pair] * (errors < _EXPLAINED_PX).mean()
    return explained, total


def _cuts(explained: Counts, total: Counts) -> list[tuple[float, float, Part]]:
    """Return the cuts of the maximum spanning tree of explained matches, the least explained first.

    Of each: the share of matches between both parts that are explained, the explained matches of the pair that joins
    them, and which photographs are in the smaller part.
    """
    tree = minimum_spanning_tree(-explained - _NO_LINK).toarray()  # all photographs are in one tree
    cuts = []
    for first, second in np.argwhere(tree):
        without = tree.copy()
        without[first, second] = 0
        _, labels = connected_components(without, directed=False)
        one, other = labels == labels[first], labels == labels[second]
        between = np.ix_(one, other)
        share = float(explained[between].sum() / max(1, total[between].sum()))
        cuts.append((share, float(-tree[first, second]), one if one.sum() <= other.sum() else other))
    return sorted(cuts, key=lambda cut: cut[:2])
