"""The coding grid has the nearest multiples of 32 as sides and covers the image exactly."""

import pytest
import torch

from fecocodec.geometry.coding_grid import grid_size, resample_to_grid


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
