"""Comparison of two rate-distortion curves: BD-rate and BD-PSNR, and the gain at equal bytes.

Bjontegaard, "Calculation of average PSNR differences between RD-curves", VCEG-M33, 2001, with piecewise cubic
interpolation instead of a polynomial, as in the common test conditions of the video standards (PCHIP: Fritsch and
Carlson, "Monotone Piecewise Cubic Interpolation", 1980).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from fecocodec.evaluation.records import Measurement

Point = tuple[float, float]  # (rate, quality); a larger quality is better, in dB for `bd_psnr`

_NUM_SAMPLES = 1001
# Photographs need very different numbers of bytes, so each pair is compared at the size of our own file, at the one
# operating point of our codec whose files have this size on average.
SIZES_KIB = (4.0, 8.0, 16.0)
_NUM_RESAMPLES = 10_000
_INTERVAL = (2.5, 97.5)  # percentiles
_NUM_HALVINGS = 60
_TOLERANCE = 0.02  # of the smallest and largest size of a curve, to which a size beyond it is moved


def bd_rate(anchor: Sequence[Point], test: Sequence[Point], *, least_overlap: float = 0.0) -> float | None:
    """Return the mean rate difference at equal quality, in percent: -50 means that `test` needs half the rate.

    Returns None if the quality ranges do not overlap by more than 0 and at least `least_overlap`, or if a curve has
    fewer than two Pareto-optimal points.
    """
    ours, theirs = pareto_front(test), pareto_front(anchor)
    difference = _mean_difference(theirs[:, ::-1], ours[:, ::-1], least_overlap)
    return None if difference is None else 100.0 * (float(np.exp(difference)) - 1.0)


def bd_psnr(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Return the mean quality difference at equal rate, in dB; positive if `test` is better.

    Returns None if the rate ranges do not overlap, or if a curve has fewer than two Pareto-optimal points.
    """
    return _mean_difference(pareto_front(anchor), pareto_front(test))


def pareto_front(points: Sequence[Point]) -> Float[np.ndarray, "point 2"]:
    """Return (log rate, quality) of the Pareto-optimal points, ordered by rate; both columns increase strictly."""
    front: list[Point] = []
    for rate, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or quality > front[-1][1]:
            front.append((float(np.log(rate)), quality))
    return np.array(front).reshape(-1, 2)


def _mean_difference(
    anchor: Float[np.ndarray, "_ 2"], test: Float[np.ndarray, "_ 2"], least_overlap: float = 0.0
) -> float | None:
    """Return the mean of test(x) - anchor(x) over the common range of x, or None if there is none."""
    if min(len(anchor), len(test)) < 2:
        return None
    low, high = max(anchor[0, 0], test[0, 0]), min(anchor[-1, 0], test[-1, 0])
    if not low < high or high - low < least_overlap:
        return None
    x = np.linspace(low, high, _NUM_SAMPLES)
    difference = PchipInterpolator(*test.T)(x) - PchipInterpolator(*anchor.T)(x)
    return float(np.trapezoid(difference, x) / (high - low))


@dataclass(frozen=True)
class Gain:
    """PSNR of our codec minus that of a baseline at equal bytes, in dB: mean over pairs, 95% interval over scenes.

    pairs: number of entries whose baseline has a curve around the size of our file; `measured` in all.
    """

    db: float
    low: float
    high: float
    pairs: int
    measured: int


def gain_at(found: Sequence[Measurement], baseline: str, kib: float, ours: str) -> Gain | None:
    """Return the gain where our files have `kib` KiB on average; PSNR is that of target views.

    Entries that lack a setting of either codec are left out. None if the size is outside our curve, or if no entry has
    a baseline around its size.
    """
    mine, theirs = _points(found, ours), _points(found, baseline)
    entries = sorted(mine.keys() & theirs.keys())
    point = _operating_point([mine[entry] for entry in entries], kib)
    if point is None:
        return None
    differences: dict[str, list[float]] = {}
    for entry, (log_bytes, psnr) in zip(entries, point, strict=True):
        other = _psnr_at(theirs[entry], float(log_bytes))
        if other is not None:
            differences.setdefault(entry.split("/")[0], []).append(float(psnr) - other)
    return _with_interval(differences, len(entries)) if differences else None


def _points(found: Sequence[Measurement], system: str) -> dict[str, Float[np.ndarray, "setting 2"]]:
    """Return (log bytes, PSNR) per setting of each entry that has all settings, in the order of their mean bytes."""
    points: dict[str, dict[str, tuple[float, float]]] = {}
    for m in found:
        if m.system == system and m.num_bytes and not m.error:
            points.setdefault(m.entry, {})[m.setting] = (float(np.log(m.num_bytes)), m.psnr)
    settings = {setting for curve in points.values() for setting in curve}
    whole = {entry: curve for entry, curve in points.items() if curve.keys() == settings}
    order = sorted(settings, key=lambda setting: sum(np.exp(curve[setting][0]) for curve in whole.values()))
    return {entry: np.array([curve[setting] for setting in order]) for entry, curve in whole.items()}


def _operating_point(
    curves: Sequence[Float[np.ndarray, "setting 2"]], kib: float
) -> Float[np.ndarray, "entry 2"] | None:
    """Return (log bytes, PSNR) of every entry at one point between two settings, whose mean size is `kib`."""
    if not curves:
        return None
    stacked = np.stack(curves)
    sizes = np.exp(stacked[..., 0]).mean(axis=0) / 1024
    if not sizes[0] * (1 - _TOLERANCE) <= kib <= sizes[-1] * (1 + _TOLERANCE):
        return None
    low, high = 0.0, len(sizes) - 1.0
    for _ in range(_NUM_HALVINGS):
        middle = (low + high) / 2
        is_small = np.exp(_between(stacked, middle)[:, 0]).mean() < kib * 1024
        low, high = (middle, high) if is_small else (low, middle)
    return _between(stacked, low)


def _between(stacked: Float[np.ndarray, "entry setting 2"], position: float) -> Float[np.ndarray, "entry 2"]:
    """Interpolate linearly between neighbouring settings. position: index of a setting, with a fraction."""
    first = min(int(position), max(stacked.shape[1] - 2, 0))
    second = min(first + 1, stacked.shape[1] - 1)
    share = position - first
    return (1 - share) * stacked[:, first] + share * stacked[:, second]


def _psnr_at(curve: Float[np.ndarray, "setting 2"], log_bytes: float) -> float | None:
    """Return the PSNR of the Pareto front of a curve at a size, None outside it."""
    front = pareto_front([(float(np.exp(rate)), float(quality)) for rate, quality in curve])
    slack = float(np.log1p(_TOLERANCE))
    if len(front) < 2 or not front[0, 0] - slack <= log_bytes <= max(curve[:, 0]) + slack:
        return None
    return float(PchipInterpolator(*front.T)(np.clip(log_bytes, front[0, 0], front[-1, 0])))


def _with_interval(differences: Mapping[str, Sequence[float]], measured: int) -> Gain:
    """Resample scenes with replacement. differences: in dB, by scene."""
    sums = np.array([sum(values) for values in differences.values()])
    counts = np.array([len(values) for values in differences.values()])
    drawn = np.random.default_rng(0).integers(0, len(sums), (_NUM_RESAMPLES, len(sums)))
    low, high = np.percentile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), _INTERVAL)
    return Gain(float(sums.sum() / counts.sum()), float(low), float(high), int(counts.sum()), measured)
