import numpy as np
import pytest

from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.lanes import NUM_LANES, lane_numbers, lanes, load, store, total, where

NUMBERS = np.arange(2 * NUM_LANES, dtype=np.float32) / 4 + 1
ONE, THREE = np.float32(1.0), np.float32(3.0)
FIRST = np.uintp(5)


@compiled
def _arithmetic(numbers, result):  # type: ignore[no-untyped-def]
    vector = load(numbers, FIRST)
    vector += ONE
    store(result, FIRST, (vector * THREE - lane_numbers()) / (ONE + vector))


@compiled
def _choices(numbers, result):  # type: ignore[no-untyped-def]
    vector = load(numbers, FIRST)
    inside = where((vector >= THREE) & (vector <= np.float32(4.5)), vector, lanes(ONE))
    store(result, FIRST, where(vector < np.float32(2.5), min(vector, np.float32(2.3)), max(inside, np.float32(1.5))))


@compiled
def _sum(numbers):  # type: ignore[no-untyped-def]
    return total(load(numbers, FIRST))


def test_lanes_are_arrays() -> None:
    result, given = np.zeros_like(NUMBERS), NUMBERS[5 : 5 + NUM_LANES] + ONE
    _arithmetic(NUMBERS, result)
    expected = (given * THREE - np.arange(NUM_LANES, dtype=np.float32)) / (ONE + given)
    np.testing.assert_allclose(result[5 : 5 + NUM_LANES], expected, rtol=1e-6)
    assert not result[:5].any()
    assert not result[5 + NUM_LANES :].any()
    result, given = np.zeros_like(NUMBERS), NUMBERS[5 : 5 + NUM_LANES]
    _choices(NUMBERS, result)
    inside = np.where((given >= 3) & (given <= 4.5), given, 1)
    expected = np.where(given < 2.5, np.minimum(given, np.float32(2.3)), np.maximum(inside, 1.5))
    assert np.array_equal(result[5 : 5 + NUM_LANES], expected)
    assert _sum(NUMBERS) == pytest.approx(NUMBERS[5 : 5 + NUM_LANES].sum())
