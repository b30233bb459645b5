"""Semi-global aggregation: against the recurrence written out, and on a surface drowned in noise."""

import pytest
import torch
from torch import Tensor

from fecocodec.sender.extractors import semi_global
from fecocodec.sender.extractors.semi_global import LARGE_STEP, SMALL_STEP, aggregated

DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def path_costs(cost: Tensor, down: int, right: int) -> Tensor:
    """Hirschmueller's equation 13 for one direction; cost and result are [h w candidate]."""
    height, width, count = cost.shape
    known: dict[tuple[int, int], Tensor] = {}

    def at(row: int, column: int) -> Tensor:
        if (row, column) not in known:
            before_row, before_column = row - down, column - right
            if not (0 <= before_row < height and 0 <= before_column < width):
                known[row, column] = cost[row, column]
            else:
                before = at(before_row, before_column)
                least = before.min()
                known[row, column] = torch.stack(
                    [
                        cost[row, column, d]
                        + min(
                            before[d],
                            *(before[n] + SMALL_STEP for n in (d - 1, d + 1) if 0 <= n < count),
                            least + LARGE_STEP,
                        )
                        - least
                        for d in range(count)
                    ]
                )
        return known[row, column]

    return torch.stack([torch.stack([at(row, column) for column in range(width)]) for row in range(height)])


def test_it_is_the_mean_of_eight_paths() -> None:
    score = 20 * torch.randn(2, 5, 4, 6, generator=torch.Generator().manual_seed(0))
    found = aggregated(score)
    for item in range(2):
        cost = -score[item].permute(1, 2, 0)
        expected = -torch.stack([path_costs(cost, *direction) for direction in DIRECTIONS]).mean(dim=0)
        torch.testing.assert_close(found[item].permute(1, 2, 0), expected, atol=1e-4, rtol=1e-5)


def test_free_steps_leave_scores_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(semi_global, "SMALL_STEP", 0.0)
    monkeypatch.setattr(semi_global, "LARGE_STEP", 0.0)
    score = torch.randn(1, 7, 5, 9, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(aggregated(score), score, atol=1e-5, rtol=0)


def test_a_slanted_surface_comes_out_of_noise() -> None:
    generator = torch.Generator().manual_seed(2)
    height, width, count = 24, 32, 12
    truth = (torch.arange(width) * (count - 1) // (width - 1)).expand(height, width)
    score = 3.0 * torch.randn(1, count, height, width, generator=generator)
    score.scatter_add_(1, truth[None, None], torch.full((1, 1, height, width), 5.0))
    raw, settled = (((x.argmax(dim=1)[0] - truth).abs() <= 1).float().mean() for x in (score, aggregated(score)))
    assert raw < 0.8
    assert settled > 0.97


def test_threads_change_nothing() -> None:
    score = torch.randn(3, 6, 8, 8, generator=torch.Generator().manual_seed(3))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        alone = aggregated(score)
        torch.set_num_threads(2)
        assert torch.equal(aggregated(score), alone)
    finally:
        torch.set_num_threads(before)
