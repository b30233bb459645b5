"""KNN attention is continuous where the set of neighbours changes, and finite for coinciding points."""

import pytest
import torch
from torch import Tensor

from fecocodec.receiver import neighbour_attention
from fecocodec.receiver.neighbour_attention import NeighbourAttention

NUM_NEIGHBOURS = 5


def attend(points: Tensor, fade: float = 1.0) -> Tensor:
    """Return the result of the first point. Features and weights are the same in every call."""
    torch.manual_seed(0)
    attention = NeighbourAttention(8, 8, NUM_NEIGHBOURS, fade).requires_grad_(False)
    features = torch.randn(len(points), 8)
    poses = torch.ones(len(points)), torch.eye(3).expand(len(points), 3, 3)
    return attention(attention.search(points), features, points, *poses)[0]


def around(radius: float) -> Tensor:
    """Return a point, three points near it, one at distance 0.2, and one at another distance on the other side."""
    near = [[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0, -0.1, 0.0]]
    return torch.tensor([*near, [0.2, 0.0, 0.0], [-radius, 0.0, 0.0]])


def jump(fade: float) -> float:
    """Return the change of the result when the sixth point replaces the other one as a neighbour."""
    return float((attend(around(0.2 - 1e-6), fade) - attend(around(0.2 + 1e-6), fade)).abs().max())


@pytest.mark.parametrize("fade", [0.25, 1.0])
def test_which_of_two_equally_far_points_is_chosen_changes_nothing(fade: float) -> None:
    assert jump(fade) < 1e-4
    assert jump(1e-9) > 1e-2, "without fading it does, or this test sees nothing"


@pytest.mark.parametrize("count", [1, 2, NUM_NEIGHBOURS, NUM_NEIGHBOURS + 1, 40])
@pytest.mark.parametrize("spread", [0.0, 1e-20, 1.0, 1e15])
def test_finite_for_few_points_for_points_in_one_place_and_for_far_ones(count: int, spread: float) -> None:
    points = spread * torch.randn(count, 3, generator=torch.Generator().manual_seed(1))
    assert bool(attend(points).isfinite().all())


@pytest.mark.parametrize("at_once", [1, 7, 39])
def test_points_are_worked_off_in_blocks_without_a_trace(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(2)
    attention = NeighbourAttention(8, 8, NUM_NEIGHBOURS, 1.0).requires_grad_(False)
    points = torch.randn(40, 3)
    poses = torch.rand(40) + 0.5, torch.linalg.qr(torch.randn(40, 3, 3)).Q
    given = attention.search(points), torch.randn(40, 8), points, *poses
    whole = attention(*given)
    monkeypatch.setattr(neighbour_attention, "POINTS_AT_ONCE", at_once)
    torch.testing.assert_close(attention(*given), whole, atol=1e-6, rtol=1e-5)
