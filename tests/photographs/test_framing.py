"""Cropping and resizing, pixel by pixel: sizes where floating point rounds against the photograph's border."""

import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.grid import grid_side
from fecocodec.limits import MANY_VIEWS_MAX_PIXELS
from fecocodec.photographs.framing import common_size, within_limit
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.resampling import crop_and_resize


@pytest.mark.parametrize(
    ("stored", "size"),
    [
        ((3000, 4000), (720, 960)),  # 960 * (4000 / 960) is more than 4000 in binary64
        ((1080, 1440), (266, 338)),
        ((68, 68), (543, 543)),
    ],
)
def test_a_crop_never_leaves_the_photograph(stored: tuple[int, int], size: tuple[int, int]) -> None:
    height, width = stored
    assert max(new * (old / new) - old for old, new in zip(stored, size, strict=True)) > 0  # or this tests nothing
    pinhole = Lens(width, height, fx=float(width), fy=float(width), cx=width / 2, cy=height / 2)
    framed, intrinsics = crop_and_resize(torch.full((3, 1, 1), 0.5).expand(-1, height, width), pinhole, size)
    assert framed.shape == (3, *size)
    torch.testing.assert_close(framed, torch.full((3, *size), 0.5))
    # A centre crop keeps the principal point at the centre, to the half pixel that the crop may be off by.
    assert abs(intrinsics[0, 2] - 0.5) * width < 1 and abs(intrinsics[1, 2] - 0.5) * height < 1


def test_a_message_has_the_size_of_the_photographs() -> None:
    rest = "but each side must have 64 to 1024; use larger images or give `size`."
    for width, height, reduced in ((8192, 256, ", reduced to 1024x32"), (96, 50, "")):
        lens = Lens(width, height, fx=width / 2, fy=width / 2, cx=width / 2, cy=height / 2)
        with pytest.raises(InputError, match=f"^a.jpg: {width}x{height} pixels{reduced}, {rest}$"):
            common_size([lens], ["a.jpg"])


@pytest.mark.parametrize(("size", "count"), [((768, 1024), 6), ((768, 1024), 16), ((1024, 64), 16), ((577, 1024), 8)])
def test_many_views_are_scaled_down_to_a_moderate_size(size: tuple[int, int], count: int) -> None:
    assert within_limit((768, 1024), 4) == (768, 1024)
    height, width = within_limit(size, count)
    assert count * grid_side(height) * grid_side(width) <= MANY_VIEWS_MAX_PIXELS
    assert height * width > 0.8 * min(size[0] * size[1], MANY_VIEWS_MAX_PIXELS / count)
    assert abs(height / width - size[0] / size[1]) < 0.01 * size[0] / size[1]
