"""The exported form of bilinear sampling is `grid_sample`, at borders and for positions that are no numbers too."""

import pytest
import torch
import torch.nn.functional as F

from fecocodec.training.graphs.exported_forms import BILINEAR, BORDER, sampled


def test_samples_are_those_of_grid_sample() -> None:
    generator = torch.Generator().manual_seed(0)
    values = torch.rand(3, 5, 6, 9, generator=generator)
    positions = 6.0 * torch.rand(3, 7, 8, 2, generator=generator) - 3.0
    positions[0, 0, :4] = torch.tensor([[-1.0, -1.0], [1.0, 1.0], [1.0, -1.0], [1e20, -1e20]])
    expected = F.grid_sample(values, positions, padding_mode="border", align_corners=False)
    found = sampled(values, positions, BILINEAR, BORDER, align_corners=False)
    torch.testing.assert_close(found, expected, rtol=0.0, atol=2e-6)


def test_a_position_that_is_no_number_harms_no_other_sample() -> None:
    values, positions = torch.rand(1, 2, 4, 4), torch.zeros(1, 1, 2, 2)
    positions[0, 0, 0] = torch.nan
    found = sampled(values, positions, BILINEAR, BORDER, align_corners=False)
    torch.testing.assert_close(found[..., 1], values[:, :, 1:3, 1:3].mean(dim=(2, 3))[..., None])


@pytest.mark.parametrize(("mode", "padding", "align_corners"), [(1, BORDER, False), (BILINEAR, 0, False), (0, 1, True)])
def test_other_modes_are_refused(mode: int, padding: int, align_corners: bool) -> None:
    with pytest.raises(ValueError, match="has an exported form"):
        sampled(torch.rand(1, 1, 4, 4), torch.zeros(1, 1, 1, 2), mode, padding, align_corners)
