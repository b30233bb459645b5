"""The coding grid has the nearest multiples of 32 as sides and covers the image exactly.

Ignored pixels are filled with the colours around them, and no other pixel changes.
"""

import pytest
import torch

from fecocodec.geometry.coding_grid import filled, grid_size, resample_to_grid


@pytest.mark.parametrize(
    ("size", "expected"),
    [((64, 64), (64, 64)), ((450, 258), (448, 256)), ((79, 80), (64, 96)), ((1024, 1009), (1024, 1024))],
)
def test_sides_are_the_nearest_multiples_of_32(size: tuple[int, int], expected: tuple[int, int]) -> None:
    assert grid_size(*size) == expected


def test_an_image_of_the_right_size_stays_as_it_is() -> None:
    images = torch.rand(2, 3, 64, 96)
    assert torch.equal(resample_to_grid(images), images)


@pytest.mark.parametrize("size", [(70, 101), (79, 80), (110, 64)])
def test_a_ramp_keeps_its_values_at_the_same_normalised_positions(size: tuple[int, int]) -> None:
    """Therefore normalised intrinsics do not change. Borders are excluded, because the filter is truncated there."""

    def ramps(height: int, width: int) -> torch.Tensor:
        rows = (torch.arange(height) + 0.5) / height
        columns = (torch.arange(width) + 0.5) / width
        return torch.stack(
            (rows[:, None].expand(-1, width), columns[None].expand(height, -1), torch.full((height, width), 0.5))
        )[None]

    resampled = resample_to_grid(ramps(*size))
    expected = ramps(*grid_size(*size))
    assert resampled.shape == expected.shape
    torch.testing.assert_close(resampled[..., 4:-4, 4:-4], expected[..., 4:-4, 4:-4], atol=2e-3, rtol=0)


def hole() -> torch.Tensor:
    ignored = torch.zeros(2, 20, 30, dtype=torch.bool)
    ignored[0, 5:15, 0:12] = True
    return ignored


def test_a_hole_gets_the_colours_around_it() -> None:
    across = torch.linspace(0.2, 0.8, 30).expand(2, 3, 20, 30)
    spoiled = torch.where(hole()[:, None], 1.0, across)
    found = filled(spoiled, hole())
    assert float((found - across).abs()[0, :, 6:14, 4:10].max()) < 0.15
    assert torch.equal(torch.where(hole()[:, None], 0.0, found), torch.where(hole()[:, None], 0.0, across))


def test_what_was_under_the_mask_does_not_matter() -> None:
    images = torch.rand(2, 3, 20, 30, generator=torch.Generator().manual_seed(0))
    assert torch.equal(filled(images, hole()), filled(torch.where(hole()[:, None], 0.5, images), hole()))
    images = torch.rand(2, 3, 20, 30)
    assert filled(images, None) is images and filled(images, torch.zeros(2, 20, 30, dtype=torch.bool)) is images
    ignored = torch.ones(1, 20, 30, dtype=torch.bool)
    assert torch.equal(filled(torch.rand(1, 3, 20, 30), ignored), torch.zeros(1, 3, 20, 30))
