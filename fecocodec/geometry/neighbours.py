"""Nearest neighbours of 3D points."""

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

LARGEST_DISTANCES = 2**26  # entries of the distance matrix held at once on a GPU: 256 MiB


@torch.no_grad()
def nearest_neighbours(
    points: Float[Tensor, "n 3"], count: int, queries: Float[Tensor, "m 3"] | None = None
) -> Int[Tensor, "m count"]:
    """Indices of the `count` points nearest to each query; repeats the nearest where n < count.

    queries: the points themselves where none are given, each of which is then among its own neighbours. On the CPU from
    a k-d tree, on a GPU from distances in chunks.
    """
    available = min(count, points.shape[0])
    queries = points if queries is None else queries
    on_cpu = points.device.type == "cpu"
    search = neighbours_by_tree if on_cpu else neighbours_by_distance
    found = search(points, available, queries)
    return found if available == count else torch.cat((found, found[:, :1].expand(-1, count - available)), dim=1)


def neighbours_by_tree(
    points: Float[Tensor, "n 3"], count: int, queries: Float[Tensor, "m 3"]
) -> Int[Tensor, "m count"]:
    """What `nearest_neighbours` does on the CPU; count <= n. Balancing the tree would cost more than it saves."""
    positions, asked = points.detach().float().numpy(), queries.detach().float().numpy()
    tree = cKDTree(positions, leafsize=12, balanced_tree=False, compact_nodes=False)
    _, index = tree.query(asked, k=count, workers=torch.get_num_threads())
    return torch.from_numpy(index.reshape(-1, count))


def neighbours_by_distance(
    points: Float[Tensor, "n 3"], count: int, queries: Float[Tensor, "m 3"]
) -> Int[Tensor, "m count"]:
    """What `nearest_neighbours` does on a GPU; count <= n.

    Distances come from differences: from a matrix product, |a|^2 + |b|^2 - 2ab, rounding would drown them.
    """
    rows = max(1, LARGEST_DISTANCES // len(points))
    distances = (
        torch.cdist(chunk, points, compute_mode="donot_use_mm_for_euclid_dist") for chunk in queries.split(rows)
    )
    return torch.cat([chunk.topk(count, dim=1, largest=False).indices for chunk in distances])
