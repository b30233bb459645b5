"""Order points such that each run of neighbours is compact: a k-d tree with median splits."""

import numpy as np
from jaxtyping import Float, Int


def kd_order(points: Float[np.ndarray, "n axis"], run: int) -> Int[np.ndarray, " n"]:
    """Return a permutation whose consecutive runs of `run` points are the leaves of a k-d tree.

    Every node is split at the middle run, along the axis of its largest extent.
    """
    leaves: list[np.ndarray] = []
    nodes = [np.arange(len(points))]
    while nodes:
        node = nodes.pop()
        if len(node) <= run:
            leaves.append(node)
            continue
        inside = points[node]
        axis = int(np.ptp(inside, axis=0).argmax())
        half = -(-len(node) // run) // 2 * run
        by_axis = np.argpartition(inside[:, axis], half)
        nodes += [node[by_axis[half:]], node[by_axis[:half]]]  # the lower half is visited first
    return np.concatenate(leaves) if leaves else np.arange(0)
