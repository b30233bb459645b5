"""The multi-view transformer with several source views, against attention written out place by place."""

import pytest
import torch
from einops import rearrange
from torch import Tensor

from fecocodec.sender.extractors.depthsplat_small.transformer import (
    BLOCKED,
    AttentionLayer,
    Block,
    ScoreMasks,
    border_mask,
    masks_of_sources,
    public_masks_of_sources,
)

H, W, CHANNELS = 4, 8, 128
WINDOW = (H // 2, W // 2)
PLAIN, SHIFTED = (0, 0), (WINDOW[0] // 2, WINDOW[1] // 2)
Place = tuple[int, int]


def places_of_window(row: int, column: int, step: Place) -> list[Place]:
    """Places on the map, row by row, of one window of the map that was rolled back by `step`."""
    rows = range(row * WINDOW[0], (row + 1) * WINDOW[0])
    columns = range(column * WINDOW[1], (column + 1) * WINDOW[1])
    return [((r + step[0]) % H, (c + step[1]) % W) for r in rows for c in columns]


def is_joined_by_wrapping(first: Place, second: Place) -> bool:
    return any(abs(a - b) >= side for a, b, side in zip(first, second, WINDOW, strict=True))


def messages(layer: AttentionLayer, queries: Tensor, maps: Tensor, sources: list[list[int]], step: Place) -> Tensor:
    """What every place gathers. Keys come as in the public code, place by place and of each place all views, under
    a mask that is made for one view and repeated whole."""
    gathered = torch.zeros_like(queries)
    windows = [places_of_window(row, column, step) for row in range(2) for column in range(2)]
    for view, chosen in enumerate(sources):
        for places in windows:
            keys = torch.stack([maps[source][place] for place in places for source in chosen])
            for place in places:
                scores = layer.k_proj(keys) @ layer.q_proj(queries[view][place]) / CHANNELS**0.5
                if step != PLAIN:
                    mask = [BLOCKED * is_joined_by_wrapping(place, other) for other in places]
                    scores = scores + torch.tensor(mask * len(chosen))
                gathered[view][place] = layer.v_proj(keys).T @ scores.softmax(dim=0)
    return layer.norm1(layer.merge(gathered))


@pytest.mark.parametrize("step", [PLAIN, SHIFTED], ids=["plain", "shifted"])
@torch.inference_mode()
def test_a_block_attends_to_the_chosen_views_as_the_public_one_does(step: Place) -> None:
    """Self-attention, then attention to what the sources were before the block, then the MLP of both."""
    torch.manual_seed(0)
    block, maps, sources = Block().eval(), torch.randn(4, H, W, CHANNELS), [[1, 2], [2, 0], [3, 1], [2, 1]]
    within = border_mask(H, W, torch.device("cpu"))
    masks = ScoreMasks(within, public_masks_of_sources(within, 2)) if step == SHIFTED else None
    found = block(maps[None], torch.tensor(sources)[None], masks)[0]

    alone = maps + messages(block.self_attn, maps, maps, [[0], [1], [2], [3]], step)
    layer = block.cross_attn_ffn
    gathered = messages(layer, alone, maps, sources, step)
    expected = alone + layer.norm2(layer.mlp(torch.cat((alone, gathered), dim=-1)))
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


def test_masks_of_several_sources() -> None:
    mask = border_mask(8, 8, torch.device("cpu"))
    assert torch.equal(public_masks_of_sources(mask, 1), mask) and torch.equal(masks_of_sources(mask, 1), mask)
    by_source = rearrange(masks_of_sources(mask, 3), "n q (s t) -> s n q t", s=3)
    assert all(torch.equal(of_source, mask) for of_source in by_source)
