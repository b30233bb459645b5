"""Points of the scene that are seen in several photographs: corners that look alike, joined from pair to pair."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import neighbour_pairs
from fecocodec.geometry.sparse_matches import CORNER_SIDE, Corners, alike

_NEIGHBOURS = 3  # with which a photograph is compared
_MOST_POINTS = 10_000  # for memory
_MOST_RATIO = 0.8  # of the angle between corners that look alike, and that to another of the same photograph


@dataclass(frozen=True)
class Observations:
    """Where points are seen. rays: (x, y) at depth 1 in the camera's frame. focal_px: in pixels of CORNER_SIDE."""

    views: Int[Tensor, " seen"]
    points: Int[Tensor, " seen"]
    rays: Float[Tensor, "seen 2"]
    focal_px: Float[Tensor, " seen"]
    num_points: int


def observations(cameras: Cameras, corners: Sequence[Corners]) -> Observations:
    """Join corners that look alike to points, at most _MOST_POINTS; without those of two corners of one photograph."""
    starts = np.cumsum([0, *(len(found.positions) for found in corners)])
    edges = [np.zeros((2, 0), dtype=np.int64)]
    distinct = [_angles_to_next(found) for found in corners]
    for first, second in neighbour_pairs(cameras, cameras.num_views, _NEIGHBOURS):
        of_first, of_second = alike(corners[first], corners[second])
        cosines = (corners[first].descriptors[of_first] * corners[second].descriptors[of_second]).sum(dim=1)
        next_one = torch.minimum(distinct[first][of_first], distinct[second][of_second])
        is_distinct = torch.acos(cosines.clamp(-1, 1)) < _MOST_RATIO * next_one
        pair = torch.stack((of_first, of_second))[:, is_distinct].numpy()
        edges.append(pair + starts[[first, second], None])
    ends = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=(starts[-1], starts[-1]))
    labels = connected_components(graph, directed=False)[1]
    used = np.unique(ends)
    views = np.searchsorted(starts, used, side="right") - 1
    labels = np.unique(labels[used], return_inverse=True)[1]
    places, counts = np.unique(np.stack((labels, views)), axis=1, return_counts=True)
    stride = max(1, -(-int(labels.max(initial=0)) // _MOST_POINTS))
    is_kept = ~np.isin(labels, places[0, counts > 1]) & (labels % stride == 0)
    points = np.unique(labels[is_kept], return_inverse=True)[1]
    positions = torch.cat([found.positions for found in corners]).double()[used[is_kept]]
    seen_by = torch.as_tensor(views[is_kept])
    intrinsics = cameras.intrinsics.double()[seen_by]
    focal = intrinsics[:, :2, :2].diagonal(dim1=1, dim2=2)
    rays = (positions - intrinsics[:, :2, 2]) / focal
    focal_px = CORNER_SIDE * focal.amin(dim=1)
    return Observations(seen_by, torch.as_tensor(points), rays, focal_px, int(points.max(initial=-1)) + 1)


def _angles_to_next(corners: Corners) -> Float[Tensor, " corner"]:
    """Return how far each corner looks from the one of the same photograph that is most like it."""
    if not len(corners.positions):
        return torch.zeros(0)
    cosines = (corners.descriptors @ corners.descriptors.T).fill_diagonal_(-1.0)
    return torch.acos(cosines.clamp(-1, 1).amax(dim=1))
