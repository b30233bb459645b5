"""Bjontegaard differences of curves whose difference is known."""

import pytest

from fecocodec.evaluation.bd_rate import bd_psnr, bd_rate

ANCHOR = [(3.0, 20.0), (6.0, 22.5), (12.0, 24.0), (30.0, 25.1), (60.0, 25.4)]


def test_half_the_bytes_is_minus_50_percent() -> None:
    half = [(rate / 2, quality) for rate, quality in ANCHOR]
    assert bd_rate(ANCHOR, half) == pytest.approx(-50.0, abs=1e-6)
    assert bd_rate(half, ANCHOR) == pytest.approx(100.0, abs=1e-6)


def test_curves_must_overlap_by_as_much_as_is_asked_for() -> None:
    other = [(rate, quality - 5.0) for rate, quality in ANCHOR]  # they share 20.0 to 20.4 dB
    assert bd_rate(ANCHOR, other) is not None and bd_rate(ANCHOR, other, least_overlap=0.3) is not None
    assert bd_rate(ANCHOR, other, least_overlap=0.5) is None


def test_a_decibel_more_is_plus_one() -> None:
    better = [(rate, quality + 1) for rate, quality in ANCHOR]
    assert bd_psnr(ANCHOR, better) == pytest.approx(1.0, abs=1e-9)


def test_points_that_another_beats_do_not_count() -> None:
    assert bd_rate(ANCHOR, [*ANCHOR, (40.0, 24.5)]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("test", [[(5.0, 30.0), (9.0, 32.0)], [(5.0, 22.0)], [(5.0, 22.0), (6.0, 21.0)]])
def test_curves_that_cannot_be_compared(test: list[tuple[float, float]]) -> None:
    assert bd_rate(ANCHOR, test) is None
