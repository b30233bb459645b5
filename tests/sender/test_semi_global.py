"""Semi-global aggregation: against the recurrence written out, and on surfaces drowned in noise.

Depth feedback for stage 2.
"""

import math

import torch
from torch import Tensor

from fecocodec.sender.extractors.protocol import DIFFERENCE_SCALE, MatchedDepth, depth_feedback
from fecocodec.sender.extractors.semi_global import ACROSS_EDGE, EDGE, LARGE_STEP, SMALL_STEP, aggregate_costs

DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def path_costs(cost: Tensor, colours: Tensor, down: int, right: int) -> Tensor:
    """Hirschmueller's equation 13 for one direction; cost and result are [h w candidate], colours [h w 3]."""
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
                difference = float((colours[row, column] - colours[before_row, before_column]).norm())
                share = ACROSS_EDGE + (1 - ACROSS_EDGE) * math.exp(-difference / EDGE)
                known[row, column] = torch.stack(
                    [
                        cost[row, column, d]
                        + min(
                            before[d],
                            *(before[n] + share * SMALL_STEP for n in (d - 1, d + 1) if 0 <= n < count),
                            least + share * LARGE_STEP,
                        )
                        - least
                        for d in range(count)
                    ]
                )
        return known[row, column]

    return torch.stack([torch.stack([at(row, column) for column in range(width)]) for row in range(height)])


def one_colour(score: Tensor) -> Tensor:
    return torch.full((len(score), 3, *score.shape[-2:]), 0.5)


def test_it_is_the_mean_of_eight_paths() -> None:
    generator = torch.Generator().manual_seed(0)
    score = 20 * torch.randn(2, 5, 4, 6, generator=generator)
    colours = 0.1 * torch.rand(2, 3, 4, 6, generator=generator)
    found = aggregate_costs(score, colours)
    for item in range(2):
        cost = -score[item].permute(1, 2, 0)
        paths = [path_costs(cost, colours[item].permute(1, 2, 0), *way) for way in DIRECTIONS]
        expected = -torch.stack(paths).mean(dim=0)
        torch.testing.assert_close(found[item].permute(1, 2, 0), expected, atol=1e-4, rtol=1e-5)


def test_surfaces_come_out_of_noise_and_end_where_colours_do() -> None:
    generator = torch.Generator().manual_seed(2)
    height, width, count = 24, 32, 12
    truth = (torch.arange(width) * (count - 1) // (width - 1)).expand(height, width)
    score = 3.0 * torch.randn(1, count, height, width, generator=generator)
    score.scatter_add_(1, truth[None, None], torch.full((1, 1, height, width), 5.0))
    found = aggregate_costs(score, one_colour(score))
    before, after = (((x.argmax(dim=1)[0] - truth).abs() <= 1).float().mean() for x in (score, found))
    assert before < 0.8
    assert after > 0.97
    # A narrow post in front of a wall, with noisy scores, keeps its depth if its colour differs from the wall's.
    generator = torch.Generator().manual_seed(4)
    height, width, count = 24, 32, 12
    is_post = ((torch.arange(width) - 15).abs() <= 1).expand(height, width)
    truth = torch.where(is_post, 9, 2)
    score = 4.0 * torch.randn(1, count, height, width, generator=generator)
    score.scatter_add_(1, truth[None, None], torch.full((1, 1, height, width), 8.0))
    coloured = one_colour(score) + 0.4 * is_post
    with_colour, without = (aggregate_costs(score, x).argmax(dim=1)[0] == truth for x in (coloured, one_colour(score)))
    assert with_colour[is_post].float().mean() > without[is_post].float().mean() + 0.5
    assert with_colour.float().mean() > 0.95


MATCHED = torch.full((1, 1, 4, 4), 0.6)


def test_depth_feedback() -> None:
    consistency = torch.zeros(1, 1, 4, 4)
    consistency[..., :2] = 1.0
    feedback = depth_feedback(MatchedDepth(MATCHED, consistency), torch.full((1, 1, 4, 4), 0.5))
    torch.testing.assert_close(feedback[0, 0, :, :2], torch.full((4, 2), 0.1 * DIFFERENCE_SCALE))
    assert float(feedback[0, 0, :, 2:].abs().max()) == 0.0
    torch.testing.assert_close(feedback[:, 1:], consistency)
    decoded = torch.full((1, 1, 4, 4), 0.5, requires_grad=True)
    assert not depth_feedback(MatchedDepth(MATCHED, torch.ones(1, 1, 4, 4)), decoded).requires_grad
