"""Parts of an estimate that hang on few matches, most others of which contradict.

Repeated facades match each other. A photograph of one that is placed at another has a few matches that fit, and what
is registered after it fits it, so the reprojection error is small. The other matches between both parts tell.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fecocodec.poses.estimate_choice import MatchedPoints, match_errors
from fecocodec.poses.estimated_cameras import EstimatedCamera, cameras_of

_EXPLAINED_PX = 4.0  # as in the reconstruction
_LEAST_SHARE = 0.75  # of the matches between two parts; chosen on training scenes
_STRONG_LINK = 30  # explained matches of a pair of photographs that join two parts in any case; pycolmap asks for 30
_NO_LINK = 1e-6  # explained matches of a pair without any

Counts = Float[np.ndarray, "camera camera"]
Part = Bool[np.ndarray, " camera"]


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
        weak = [part for share, link, part in cuts if share < _LEAST_SHARE and link < _STRONG_LINK]
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
