"""Windows and masks of the multi-view transformer against their description, position by position."""

import math

import pytest
import torch
from einops import rearrange

from fecocodec.sender.extractors.depthsplat_small.transformer import (
    BLOCKED,
    border_mask,
    from_windows,
    into_windows,
    masks_of_sources,
    position_encoding,
    public_masks_of_sources,
    shift,
)

CPU = torch.device("cpu")


def test_windows_are_put_together_again() -> None:
    maps = torch.randn(2, 3, 8, 12, 5)
    windows = into_windows(maps)
    assert windows.shape == (2, 3, 4, 24, 5)
    assert torch.equal(windows[1, 2, 1, 6 * 2 + 3], maps[1, 2, 2, 6 + 3])
    assert torch.equal(from_windows(windows, 8), maps)


@pytest.mark.parametrize(("h", "w"), [(8, 12), (4, 4), (6, 10)])
def test_the_mask_separates_what_only_wrapping_joins(h: int, w: int) -> None:
    """Two positions of a shifted window may attend to each other exactly where they were neighbours before."""
    rows, columns = torch.meshgrid(torch.arange(h), torch.arange(w), indexing="ij")
    step = shift(h, w)
    places = torch.stack((rows, columns), dim=-1).float().roll((-step[0], -step[1]), dims=(0, 1))
    windows = into_windows(places)
    is_joined_by_wrapping = (windows[:, :, None] - windows[:, None]).abs() >= torch.tensor([h // 2, w // 2])
    assert torch.equal(border_mask(h, w, CPU) == BLOCKED, is_joined_by_wrapping.any(dim=-1))


def test_masks_of_several_sources() -> None:
    mask = border_mask(8, 8, CPU)
    assert torch.equal(public_masks_of_sources(mask, 1), mask) and torch.equal(masks_of_sources(mask, 1), mask)
    by_source = rearrange(masks_of_sources(mask, 3), "n q (s t) -> s n q t", s=3)
    assert all(torch.equal(of_source, mask) for of_source in by_source)


def test_the_public_mask_is_laid_over_keys_in_the_public_order() -> None:
    """The public code has keys position by position, the views of a position together, and a mask repeated whole."""
    mask, num_sources = torch.randn(4, 6, 6), 2
    public_keys = [(token, source) for token in range(6) for source in range(num_sources)]
    public_mask = torch.cat([mask] * num_sources, dim=-1)
    ours = public_masks_of_sources(mask, num_sources)
    for place, (token, source) in enumerate(public_keys):
        assert torch.equal(ours[..., source * 6 + token], public_mask[..., place])


def test_position_encoding_repeats_in_every_window() -> None:
    encoding = position_encoding(8, 12, 128, CPU)
    assert encoding.shape == (8, 12, 128)
    assert torch.equal(encoding[:4, :6], encoding[4:, 6:])
    turn = 2 * math.pi * 3 / 4  # third of four rows
    torch.testing.assert_close(encoding[2, 0, :2], torch.tensor([math.sin(turn), math.cos(turn)]), atol=1e-5, rtol=0)
    slower = turn / 10000 ** (2 / 64)
    torch.testing.assert_close(
        encoding[2, 0, 2:4], torch.tensor([math.sin(slower), math.cos(slower)]), atol=1e-5, rtol=0
    )
    assert torch.equal(encoding[2, 0, :64], encoding[2, 5, :64]) and torch.equal(
        encoding[0, 4, 64:], encoding[3, 4, 64:]
    )
