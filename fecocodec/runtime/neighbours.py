"""Exact nearest neighbours of 3D points with NumPy: leaves of a balanced k-d tree, searched leaf by leaf."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt64

from fecocodec.geometry.kd_leaves import kd_leaves

LEAF_SIZE = 128  # points
LARGEST_BLOCK = 1 << 22  # distances that are held at once, so that memory is bounded for any points
_SLACK = np.float32(1.00001)  # on squared distances, more than the rounding errors of float32


def nearest_neighbours(
    points: Float32[np.ndarray, "n 3"], count: int, num_threads: int = 1
) -> Int32[np.ndarray, "n count"]:
    """Return the indices of the `count` points nearest to each point, itself included, nearest first.

    Points that are not finite count as the origin; of points at equal distance the smaller index is the nearer one.
    Squared distances are computed in float32. count must be at most n. Time is at most quadratic in n, also if all
    points coincide.
    """
    positions = np.where(np.isfinite(points), points, np.float32(0.0))
    leaves = kd_leaves(positions, LEAF_SIZE)
    lowest = np.stack([positions[leaf].min(axis=0) for leaf in leaves])
    highest = np.stack([positions[leaf].max(axis=0) for leaf in leaves])
    found = np.empty((len(points), count), np.int32)

    def search(number: int) -> None:
        leaf = leaves[number]
        reach = _reach(positions, leaf, leaves, number, count)
        box = lowest[number], highest[number]
        near_leaves = np.flatnonzero(_squared_gaps(lowest, highest, *box) <= reach * _SLACK)
        inside = np.concatenate([leaves[index] for index in near_leaves])
        is_near = _squared_gaps(positions[inside], positions[inside], *box) <= reach * _SLACK
        candidates = np.sort(inside[is_near])
        for rows in np.array_split(leaf, max(1, len(leaf) * len(candidates) // LARGEST_BLOCK + 1)):
            found[rows] = _nearest(positions, rows, candidates, count)

    with ThreadPoolExecutor(num_threads) as pool:
        for _ in pool.map(search, range(len(leaves))):
            pass
    return found


def _squared_gaps(
    lowest: Float32[np.ndarray, "n 3"],
    highest: Float32[np.ndarray, "n 3"],
    low: Float32[np.ndarray, " 3"],
    high: Float32[np.ndarray, " 3"],
) -> Float32[np.ndarray, " n"]:
    """Return the squared distances between boxes and one box, given by their corners; 0 for boxes that overlap."""
    gaps = np.maximum(lowest - high, low - highest).clip(min=0.0)
    return np.einsum("ni,ni->n", gaps, gaps)


def _reach(
    positions: Float32[np.ndarray, "n 3"],
    leaf: Int64[np.ndarray, " _"],
    leaves: list[Int64[np.ndarray, " _"]],
    number: int,
    count: int,
) -> np.float32:
    """Return a squared distance within which every point of a leaf has at least `count` neighbours."""
    sample, spread = leaf, 0
    while len(sample) < count:
        spread += 1
        sample = np.concatenate(leaves[max(0, number - spread) : number + spread + 1])
    distances = _squared_distances(positions[leaf], positions[sample])
    return np.partition(distances, count - 1, axis=1)[:, count - 1].max()


def _nearest(
    positions: Float32[np.ndarray, "n 3"],
    rows: Int64[np.ndarray, " m"],
    candidates: Int64[np.ndarray, " c"],
    count: int,
) -> Int32[np.ndarray, "m count"]:
    """Return the nearest candidates of some points. Sorting keys are the bits of the distance, then the index."""
    distances = _squared_distances(positions[rows], positions[candidates])
    keys: UInt64[np.ndarray, "m c"] = distances.view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= candidates.astype(np.uint64)
    nearest = np.sort(np.partition(keys, count - 1, axis=1)[:, :count], axis=1)
    return (nearest & np.uint64(0xFFFFFFFF)).astype(np.int32)


def _squared_distances(
    first: Float32[np.ndarray, "m 3"], second: Float32[np.ndarray, "c 3"]
) -> Float32[np.ndarray, "m c"]:
    total = np.zeros((len(first), len(second)), np.float32)
    with np.errstate(over="ignore"):  # an infinite distance is the largest one
        for axis in range(3):
            difference = first[:, axis, None] - second[:, axis]
            difference *= difference
            total += difference
    return total
