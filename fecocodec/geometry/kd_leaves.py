"""Leaves of a k-d tree: groups of near points."""

import numpy as np
from jaxtyping import Float, Int64


def kd_leaves(points: Float[np.ndarray, "n axis"], size: int) -> list[Int64[np.ndarray, " _"]]:
    """Return the indices of the points of each leaf. Each has `size` points, but the last; neighbours are close.

    Every node is split at the middle multiple of `size`, along the axis of its largest extent.
    """
    leaves, nodes = [], [np.arange(len(points))]
    while nodes:
        node = nodes.pop()
        if len(node) <= size:
            leaves.append(node)
            continue
        inside = points[node]
        axis = int(np.ptp(inside, axis=0).argmax())
        half = -(-len(node) // size) // 2 * size
        by_axis = np.argpartition(inside[:, axis], half)
        nodes += [node[by_axis[half:]], node[by_axis[:half]]]  # the lower half is visited first
    return leaves
