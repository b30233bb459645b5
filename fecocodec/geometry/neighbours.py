"""Nearest neighbours of 3D points."""

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

CHUNK = 4096  # rows of the distance matrix held at once on a GPU


@torch.no_grad()
def nearest_neighbours(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n count"]:
    """Indices of the `count` points nearest to each point, itself among them; repeats the nearest where n < count.

    On the CPU from a k-d tree, on a GPU from distances in chunks.
    """
    available = min(count, points.shape[0])
    found = _on_cpu(points, available) if points.device.type == "cpu" else _on_gpu(points, available)
    return found if available == count else torch.cat((found, found[:, :1].expand(-1, count - available)), dim=1)


def _on_cpu(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n count"]:
    positions = points.detach().float().numpy()
    tree = cKDTree(positions, leafsize=12, balanced_tree=False, compact_nodes=False)
    _, index = tree.query(positions, k=count, workers=torch.get_num_threads())
    return torch.from_numpy(index.reshape(-1, count))


def _on_gpu(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n count"]:
    chunks = (torch.cdist(chunk, points).topk(count, dim=1, largest=False).indices for chunk in points.split(CHUNK))
    return torch.cat(list(chunks))
