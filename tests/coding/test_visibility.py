"""Factors of opacities from the coverage and fading sections, in the order of the Gaussians."""

from dataclasses import replace

import numpy as np
import pytest

from fecocodec.coding.visibility import pack_levels, unpack_levels, visibility_of
from fecocodec.container import Stream
from tests.vectors.chosen_symbols import Recipe, cameras_of, stream_of_recipe


@pytest.fixture(scope="module")
def stream() -> Stream:
    """Two views of 64x128 pixels: 4x8 blocks of 16x16 pixels, 32x64 Gaussians each."""
    return stream_of_recipe(Recipe(64, 128, cameras=cameras_of(2)))


def test_levels_of_blocks(stream: Stream) -> None:
    assert visibility_of(stream) is None
    levels = np.zeros((2, 4, 8), np.uint8)
    levels[1, 2, 5] = 2
    factors = visibility_of(replace(stream, fading=pack_levels(levels))).reshape(2, 32, 64)
    assert factors.dtype == np.float32
    expected = np.ones((2, 32, 64), np.float32)
    expected[1, 16:24, 40:48] = np.float32(1) / np.float32(3)
    assert np.array_equal(factors, expected)
    levels = np.zeros((2, 4, 8), np.uint8)
    levels[0, 0, :4] = range(4)
    factors = visibility_of(replace(stream, fading=pack_levels(levels)), gaussians_per_side=1)
    assert factors[:16:4].tolist() == [1.0, np.float32(2) / 3, np.float32(1) / 3, 0.0]
    levels = np.zeros((2, 4, 8), np.uint8)
    levels[0, 0, :5] = 3, 0, 2, 1, 2
    packed = pack_levels(levels)
    assert packed[:3] == bytes((0b11001001, 0b10000000, 0)) and len(packed) == 16
    assert np.array_equal(unpack_levels(packed, stream.header), levels)


def test_uncovered_cells_stay_invisible_in_blocks_that_are_not_faded(stream: Stream) -> None:
    cells, levels = np.ones((2, 16, 32), np.uint8), np.zeros((2, 4, 8), np.uint8)
    cells[0, 0, 1], levels[0, 0, 0] = 0, 1
    both = replace(stream, coverage=np.packbits(cells).tobytes(), fading=pack_levels(levels))
    row = visibility_of(both).reshape(2, 32, 64)[0, 0]
    assert row[:4].tolist() == [np.float32(2) / 3] * 2 + [0.0] * 2
    assert row[8:].tolist() == [1.0] * 56
