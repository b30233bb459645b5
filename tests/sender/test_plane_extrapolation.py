"""Planes extrapolated to pixels whose depth no other view confirms."""

import pytest
import torch
from torch import Tensor

from fecocodec.sender.extractors.plane_extrapolation import extrapolate_planes

GREY, RED = torch.tensor([0.5, 0.5, 0.5]), torch.tensor([0.8, 0.2, 0.2])


def painted(colour: Tensor, height: int, width: int) -> Tensor:
    """An image four times the size of a disparity map."""
    return colour.view(1, 3, 1, 1).repeat(1, 1, 4 * height, 4 * width)


def ramp(height: int, width: int, first: float, last: float) -> Tensor:
    """A plane: relative disparity that changes evenly from the left to the right."""
    return torch.linspace(first, last, width).expand(height, width)[None, None].clone()


def seen_left_of(column: int, height: int, width: int) -> Tensor:
    consistency = torch.zeros(1, 1, height, width)
    consistency[..., :column] = 0.95
    return consistency


@pytest.mark.parametrize(("height", "width"), [(16, 16), (32, 56), (72, 128)])
def test_a_plane_goes_on_where_it_is_not_confirmed(height: int, width: int) -> None:
    plane, column = ramp(height, width, 0.2, 0.6), width * 5 // 8
    matched = plane.clone()
    matched[..., column:] = 0.95  # what matching makes of what the other view does not see
    found = extrapolate_planes(matched, seen_left_of(column, height, width), painted(GREY, height, width))
    assert found.shape == plane.shape
    assert float((found - plane).abs().max()) < 0.03
    assert float((found - plane)[..., :column].abs().max()) < 0.01


def test_surfaces_keep_their_colour_and_bear_wrong_confirmations() -> None:
    far, near = ramp(32, 32, 0.2, 0.2), ramp(32, 32, 0.7, 0.7)
    images = painted(GREY, 32, 32)
    images[..., 64:, :] = RED.view(3, 1, 1)
    truth = torch.cat((far[..., :16, :], near[..., 16:, :]), dim=2)
    found = extrapolate_planes(truth, seen_left_of(20, 32, 32), images)
    assert float((found - truth).abs().max()) < 0.02
    plane = ramp(32, 32, 0.3, 0.5)
    matched = plane.clone()
    matched[..., 4:12, 4:12] = 0.9
    found = extrapolate_planes(matched, seen_left_of(24, 32, 32), painted(GREY, 32, 32))
    assert float((found - plane)[..., 16:].abs().max()) < 0.02


@pytest.mark.parametrize("consistency", [0.0, 1e-3])
def test_without_any_confirmation_it_stays_in_range(consistency: float) -> None:
    generator = torch.Generator().manual_seed(0)
    noise, images = torch.rand(2, 1, 24, 16, generator=generator), torch.rand(2, 3, 96, 64, generator=generator)
    found = extrapolate_planes(noise, torch.full_like(noise, consistency), images)
    assert bool(torch.isfinite(found).all())
    assert 0.0 <= float(found.min()) <= float(found.max()) <= 1.0


def test_views_do_not_influence_each_other() -> None:
    generator = torch.Generator().manual_seed(1)
    relative, consistency = torch.rand(2, 2, 1, 16, 16, generator=generator)
    images = torch.rand(2, 3, 64, 64, generator=generator)
    both = extrapolate_planes(relative, consistency, images)
    alone = torch.cat([extrapolate_planes(relative[[i]], consistency[[i]], images[[i]]) for i in (0, 1)])
    torch.testing.assert_close(both, alone)
