"""The neighbour search finds what the k-d tree of the receiver with torch finds."""

import numpy as np
import pytest
import torch

from fecocodec.geometry.neighbours import neighbours_by_tree
from fecocodec.runtime.neighbours import nearest_neighbours


def surfaces(num_views: int, side: int) -> np.ndarray:
    """Return points on one wavy surface per view, as the predictor has them."""
    generator = np.random.default_rng(num_views)
    v, u = np.meshgrid(*(2 * [(np.arange(side) + 0.5) / side - 0.5]), indexing="ij")
    views = []
    for view in range(num_views):
        depth = 3 + np.sin(5 * u + view) + np.cos(4 * v) - (np.hypot(u, v) < 0.2)
        depth += 0.02 * generator.standard_normal(depth.shape)
        views.append(np.stack((u * depth + 0.2 * view, v * depth, depth), axis=-1).reshape(-1, 3))
    return np.concatenate(views).astype(np.float32)


def by_tree(points: np.ndarray, count: int) -> np.ndarray:
    tensor = torch.from_numpy(points)
    return neighbours_by_tree(tensor, count).numpy()


@pytest.mark.parametrize(("num_views", "side"), [(1, 8), (2, 32), (5, 24)])
def test_the_same_neighbours_in_the_same_order(num_views: int, side: int) -> None:
    points = surfaces(num_views, side)
    assert np.array_equal(nearest_neighbours(points, 25), by_tree(points, 25))


def test_coinciding_and_endless_points() -> None:
    points = np.repeat(surfaces(1, 8), 40, axis=0)[np.random.default_rng(1).permutation(64 * 40)]
    assert np.array_equal(nearest_neighbours(points, 25), by_tree(points, 25))
    assert np.array_equal(nearest_neighbours(np.zeros((3000, 3), np.float32), 25), np.tile(np.arange(25), (3000, 1)))
    points = surfaces(2, 16)
    points[::7, 1] = np.nan
    points[3::11] = -np.inf
    assert np.array_equal(nearest_neighbours(points, 25), by_tree(points, 25))
    points = np.float32(1e30) * surfaces(1, 16)
    assert np.array_equal(nearest_neighbours(points, 25)[:, 0], np.arange(256))
