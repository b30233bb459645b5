"""PSNR at equal bytes, from curves whose difference is known."""

from dataclasses import replace

import numpy as np
import pytest

from fecocodec.evaluation.bd_rate import bd_psnr, bd_rate, gain_at
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.rate_section import equal_bytes_table

SCENES = ("kitchen", "garden", "street")
GAINS = {"kitchen": 0.2, "garden": 0.5, "street": 1.1}  # dB
WEIGHTS = {"kitchen": 0.5, "garden": 1.0, "street": 1.5}  # bytes of a scene relative to the mean


def codec(name: str, sizes_kib: tuple[float, ...], gains: dict[str, float]) -> list[Measurement]:
    """Two entries per scene, on curves of 2 dB per doubling of the bytes."""
    return [
        Measurement(
            f"{scene}/near{number}",
            name,
            f"setting {kib}",
            "model",
            num_bytes=round(1024 * kib * WEIGHTS[scene]),
            psnr=20.0 + 2.0 * float(np.log2(kib * WEIGHTS[scene])) + gains[scene],
        )
        for scene in SCENES
        for number in (1, 2)
        for kib in sizes_kib
    ]


OURS = codec("fecosplat", (4.0, 9.0, 17.0), GAINS)
AVIF = codec("AVIF", (1.0, 3.0, 5.0, 14.0, 40.0), dict.fromkeys(SCENES, 0.0))


@pytest.mark.parametrize("kib", [4.0, 8.0, 16.0])
def test_the_gain_is_the_mean_over_pairs_at_the_size_of_each(kib: float) -> None:
    found = gain_at(OURS + AVIF, "AVIF", kib, "fecosplat")
    assert found is not None and (found.pairs, found.measured) == (6, 6)
    assert found.db == pytest.approx(0.6, abs=0.01)  # the baseline's curve is interpolated
    assert (found.low, found.high) == (pytest.approx(0.2, abs=0.01), pytest.approx(1.1, abs=0.01))
    assert gain_at(OURS + AVIF, "AVIF", kib, "fecosplat") == found, "the interval is the same in every run"


def test_scenes_are_resampled_and_not_their_entries() -> None:
    """Twice as many entries of the same scenes give the same interval."""
    half = [m for m in OURS + AVIF if m.entry.endswith("1")]
    found, of_half = gain_at(OURS + AVIF, "AVIF", 8.0, "fecosplat"), gain_at(half, "AVIF", 8.0, "fecosplat")
    assert found is not None and of_half is not None
    assert (of_half.low, of_half.high) == (pytest.approx(found.low, abs=1e-6), pytest.approx(found.high, abs=1e-6))


def test_pairs_without_a_point_are_left_out() -> None:
    assert (
        gain_at(OURS + AVIF, "AVIF", 3.9, "fecosplat") is None
        and gain_at(OURS + AVIF, "AVIF", 17.5, "fecosplat") is None
    )
    assert gain_at(OURS + AVIF, "AVIF", 3.95, "fecosplat") is not None, "2% beyond the end count as the end"
    assert gain_at(OURS, "AVIF", 8.0, "fecosplat") is None
    flat = [m if "street" not in m.entry else replace(m, num_bytes=m.num_bytes // 8) for m in AVIF]
    found = gain_at(OURS + flat, "AVIF", 8.0, "fecosplat")
    assert found is not None and (found.pairs, found.measured) == (4, 6)
    assert found.db == pytest.approx(0.35, abs=0.01) and found.high == pytest.approx(0.5, abs=0.01)
    assert "+0.35 (+0.20 to +0.50, 4 of 6)" in equal_bytes_table(OURS + flat, ["AVIF"])


def test_the_table_has_a_row_per_baseline_and_none_for_what_has_no_curve() -> None:
    plane = [Measurement(m.entry, "best plane", "oracle", "model", psnr=20.0) for m in OURS]
    lines = equal_bytes_table(OURS + AVIF + plane, ["fecosplat", "AVIF", "best plane"]).splitlines()
    assert lines[0] == "| against | fecosplat at 4 KiB | fecosplat at 8 KiB | fecosplat at 16 KiB |"
    assert len(lines) == 3 and lines[2].startswith("| AVIF | +0.60 (+0.20 to +1.10) | ")


ANCHOR = [(3.0, 20.0), (6.0, 22.5), (12.0, 24.0), (30.0, 25.1), (60.0, 25.4)]


def test_known_differences() -> None:
    half = [(rate / 2, quality) for rate, quality in ANCHOR]
    assert bd_rate(ANCHOR, half) == pytest.approx(-50.0, abs=1e-6)
    assert bd_rate(half, ANCHOR) == pytest.approx(100.0, abs=1e-6)
    better = [(rate, quality + 1) for rate, quality in ANCHOR]
    assert bd_psnr(ANCHOR, better) == pytest.approx(1.0, abs=1e-9)
    assert bd_rate(ANCHOR, [*ANCHOR, (40.0, 24.5)]) == pytest.approx(0.0, abs=1e-9)
    other = [(rate, quality - 5.0) for rate, quality in ANCHOR]  # they share 20.0 to 20.4 dB
    assert bd_rate(ANCHOR, other) is not None and bd_rate(ANCHOR, other, least_overlap=0.3) is not None
    assert bd_rate(ANCHOR, other, least_overlap=0.5) is None


@pytest.mark.parametrize("test", [[(5.0, 30.0), (9.0, 32.0)], [(5.0, 22.0)], [(5.0, 22.0), (6.0, 21.0)]])
def test_curves_that_cannot_be_compared(test: list[tuple[float, float]]) -> None:
    assert bd_rate(ANCHOR, test) is None
