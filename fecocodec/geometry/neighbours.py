"""Nearest neighbours of 3D points."""

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, Int64
from scipy.spatial import cKDTree
from torch import Tensor

MAX_DISTANCES = 2**26  # 256 MiB


@torch.no_grad()
def nearest_neighbours(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n count"]:
    """Return the indices of the `count` points nearest to each point; repeats the nearest if n < count.

    Each point is among its own neighbours, unless more than `count` points coincide with it. Uses a k-d tree on the CPU
    and brute-force distances in chunks on a GPU.
    """
    available = min(count, points.shape[0])
    on_cpu = points.device.type == "cpu"
    search = neighbours_by_tree if on_cpu else neighbours_by_distance
    found = search(points, available)
    return found if available == count else torch.cat((found, found[:, :1].expand(-1, count - available)), dim=1)


def neighbours_by_tree(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n count"]:
    """Search on the CPU; count <= n. Coinciding points are ordered by index.

    The tree holds every position once, because a leaf with many equal points would make the search quadratic. Points
    that are not finite count as the origin. An unbalanced tree is faster here, including its construction.
    """
    values = points.detach().float()
    values = torch.where(values.isfinite(), values, 0.0)
    positions = asked = np.ascontiguousarray(values.numpy() + np.float32(0.0))  # +0 for -0
    groups = _coinciding(positions)
    if groups is not None:
        positions = positions[groups.first]
    tree = cKDTree(positions, leafsize=12, balanced_tree=False, compact_nodes=False)
    width = min(count, len(positions))
    _, index = tree.query(asked, k=width, workers=torch.get_num_threads())
    index = np.asarray(index, dtype=np.int64).reshape(-1, width)
    return torch.from_numpy(index if groups is None else groups.members(index, count))


def neighbours_by_distance(
    points: Float[Tensor, "n 3"], count: int, max_distances: int = MAX_DISTANCES
) -> Int[Tensor, "n count"]:
    """Search on a GPU; count <= n. max_distances: entries of the distance matrix held at once.

    Distances are computed from differences. The matrix product |a|^2 + |b|^2 - 2ab has rounding errors larger than the
    distances.
    """
    rows = max(1, max_distances // len(points))
    distances = (
        torch.cdist(chunk, points, compute_mode="donot_use_mm_for_euclid_dist") for chunk in points.split(rows)
    )
    return torch.cat([chunk.topk(count, dim=1, largest=False).indices for chunk in distances])


class _Groups:
    """Points grouped by position. first: index of the first point of each group."""

    def __init__(self, group_of_point: Int64[np.ndarray, " n"], num_groups: int) -> None:
        self._size = np.bincount(group_of_point, minlength=num_groups)
        self._start = np.cumsum(self._size) - self._size
        self._points = np.argsort(group_of_point, kind="stable")  # by group, then by index
        self.first = self._points[self._start]

    def members(self, groups: Int64[np.ndarray, "m width"], count: int) -> Int64[np.ndarray, "m count"]:
        """Return the first `count` points of the groups in each row, group after group."""
        end = np.cumsum(self._size[groups], axis=1)
        found = np.empty((len(groups), count), np.int64)
        rows = np.arange(len(groups))
        for slot in range(count):
            column = (end <= slot).sum(axis=1)
            group = groups[rows, column]
            found[:, slot] = self._points[self._start[group] + slot - (end[rows, column] - self._size[group])]
        return found


def _coinciding(positions: Float32[np.ndarray, "n 3"]) -> _Groups | None:
    """Group points of equal position. Returns None if no two coincide; one sort of hashes detects this usual case."""
    words = positions.view(np.uint32).astype(np.uint64)
    hashes = words @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    if len(np.unique(hashes)) == len(positions):
        return None
    unique, group_of_point = np.unique(positions, axis=0, return_inverse=True)
    return _Groups(group_of_point.reshape(-1).astype(np.int64), len(unique))
