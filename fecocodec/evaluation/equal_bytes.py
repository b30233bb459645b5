"""PSNR at equal bytes: the difference between two codecs, with an interval by bootstrap over scenes.

Photographs need very different numbers of bytes, so means over pairs are compared at one operating point of our codec,
whose files have the asked size on average: each pair is compared at the size of its own file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from fecocodec.evaluation.bd_rate import pareto_front
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.summary import OURS

SIZES_KIB = (4.0, 8.0, 16.0)
_NUM_RESAMPLES = 10_000
_INTERVAL = (2.5, 97.5)  # percentiles
_NUM_HALVINGS = 60
_TOLERANCE = 0.02  # of the smallest and largest size of a curve, to which a size beyond it is moved


@dataclass(frozen=True)
class Gain:
    """PSNR of our codec minus that of a baseline at equal bytes, in dB: mean over pairs, and its 95% interval.

    pairs: number of entries whose baseline has a curve around the size of our file; `measured` in all.
    """

    db: float
    low: float
    high: float
    pairs: int
    measured: int


def gain_at(found: Sequence[Measurement], baseline: str, kib: float, ours: str = OURS) -> Gain | None:
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
