"""Both neighbour searches agree with brute force."""

from collections.abc import Callable
from time import perf_counter

import pytest
import torch
from torch import Tensor

from fecocodec.geometry.neighbours import nearest_neighbours, neighbours_by_distance

Search = Callable[[Tensor, int], Tensor]


def by_distance_in_chunks(points: Tensor, count: int) -> Tensor:
    return neighbours_by_distance(points, count, max_distances=100 * len(points))


@pytest.mark.parametrize("search", [nearest_neighbours, neighbours_by_distance, by_distance_in_chunks])
@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_the_nearest_points_are_found(search: Search, offset: float) -> None:
    points = torch.randn(333, 3, generator=torch.Generator().manual_seed(0)) + offset
    distances = (points.double()[:, None] - points.double()).norm(dim=-1)
    found = search(points, 7)
    torch.testing.assert_close(
        distances.gather(1, found).sort(dim=1).values, distances.topk(7, largest=False).values, atol=1e-5, rtol=0
    )
    assert bool((found == torch.arange(333)[:, None]).any(dim=1).all())  # a point is among its own neighbours
    assert all(len(set(row)) == 7 for row in found.tolist())


@pytest.mark.parametrize("num_points", [1, 3])
def test_too_few_points_repeat_the_nearest(num_points: int) -> None:
    points = torch.arange(3.0 * num_points).view(num_points, 3)
    found = nearest_neighbours(points, 5)
    assert found.shape == (num_points, 5)
    assert torch.equal(found[:, num_points:], torch.arange(num_points)[:, None].expand(-1, 5 - num_points))


def test_coinciding_points_come_by_index_and_take_little_time() -> None:
    """In a plain k-d tree they would all be in one leaf, which every query would scan."""
    points = torch.zeros(50_000, 3)
    points[25_000:] = torch.tensor([1.0, -0.0, 0.0])
    begin = perf_counter()
    found = nearest_neighbours(points, 25)
    assert perf_counter() - begin < 20.0
    assert torch.equal(found[:25_000], torch.arange(25).expand(25_000, -1))
    assert torch.equal(found[25_000:], (25_000 + torch.arange(25)).expand(25_000, -1))


def test_coinciding_and_endless_points() -> None:
    generator = torch.Generator().manual_seed(0)
    single = torch.randn(200, 3, generator=generator)
    points = torch.cat((single, single[:50], single[:20]))[torch.randperm(270, generator=generator)]
    distances = torch.cdist(points.double(), points.double(), compute_mode="donot_use_mm_for_euclid_dist")
    found = nearest_neighbours(points, 9)
    assert all(len(set(row)) == 9 for row in found.tolist())
    torch.testing.assert_close(distances.gather(1, found), distances.topk(9, largest=False).values, atol=1e-6, rtol=0)
    points = torch.tensor([[0.1, 0.0, 0.0], [float("nan"), 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, float("inf"), 0.0]])
    assert nearest_neighbours(points, 2).tolist() == [[0, 1], [1, 3], [2, 0], [1, 3]]
