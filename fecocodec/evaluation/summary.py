"""Averages over entries, and comparisons of rate-distortion curves, as rows of tables."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean, median
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from fecocodec.evaluation.records import Measurement

Point = tuple[float, float]  # (rate, quality); a larger quality is better, in dB for `bd_psnr`

_NUM_SAMPLES = 1001


def bd_rate(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Return the mean rate difference at equal quality, in percent: -50 means that `test` needs half the rate.

    Returns None if the quality ranges do not overlap, or if a curve has fewer than two Pareto-optimal points.
    """
    ours, theirs = _front(test), _front(anchor)
    difference = _mean_difference(_swapped(theirs), _swapped(ours))
    return None if difference is None else 100.0 * (float(np.exp(difference)) - 1.0)


def bd_psnr(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Return the mean quality difference at equal rate, in dB; positive if `test` is better.

    Returns None if the rate ranges do not overlap, or if a curve has fewer than two Pareto-optimal points.
    """
    return _mean_difference(_front(anchor), _front(test))


def _front(points: Sequence[Point]) -> Float[np.ndarray, "point 2"]:
    """Return (log rate, quality) of the Pareto-optimal points, ordered by rate; both columns increase strictly."""
    front: list[Point] = []
    for rate, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or quality > front[-1][1]:
            front.append((float(np.log(rate)), quality))
    return np.array(front).reshape(-1, 2)


def _swapped(curve: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
    return curve[:, ::-1]


def _mean_difference(anchor: Float[np.ndarray, "_ 2"], test: Float[np.ndarray, "_ 2"]) -> float | None:
    """Return the mean of test(x) - anchor(x) over the common range of x, or None if there is none."""
    if min(len(anchor), len(test)) < 2:
        return None
    low, high = max(anchor[0, 0], test[0, 0]), min(anchor[-1, 0], test[-1, 0])
    if not low < high:
        return None
    x = np.linspace(low, high, _NUM_SAMPLES)
    difference = PchipInterpolator(*test.T)(x) - PchipInterpolator(*anchor.T)(x)
    return float(np.trapezoid(difference, x) / (high - low))


OURS = "fecosplat"


@dataclass(frozen=True)
class Average:
    """Average of one system at one setting over `entries` entries.

    Fields are means over entries, except for seconds (medians) and peak_mib (maximum). None: not available.
    """

    system: str
    setting: str
    entries: int
    kib: float
    bits_per_pixel: float
    gaussians: float
    psnr: float
    ssim: float
    ms_ssim: float | None
    flip: float | None
    st_lpips: float | None
    lpips: float | None
    context_psnr: float
    encode_seconds: float
    decode_seconds: float
    peak_mib: float | None


@runtime_checkable
class RatedPoint(Protocol):
    """A point of a rate-distortion curve: an `Average`, or a row measured elsewhere. None: not available."""

    @property
    def system(self) -> str: ...
    @property
    def setting(self) -> str: ...
    @property
    def kib(self) -> float | None: ...
    @property
    def psnr(self) -> float | None: ...
    @property
    def st_lpips(self) -> float | None: ...


@dataclass(frozen=True)
class Comparison:
    """BD metrics of our curve against that of a baseline. None: the curves do not overlap, or a metric is missing.

    bd_rate: percent, at equal PSNR. bd_psnr: dB. bd_rate_st_lpips: percent, at equal ST-LPIPS.
    """

    baseline: str
    bd_rate: float | None
    bd_psnr: float | None
    bd_rate_st_lpips: float | None


def averages(measurements: Sequence[Measurement]) -> tuple[Average, ...]:
    """Return one average per system and setting, over the entries that all of them have measured without error."""
    points: dict[tuple[str, str], dict[str, Measurement]] = {}
    for measurement in measurements:
        if not measurement.error:
            points.setdefault((measurement.system, measurement.setting), {})[measurement.entry] = measurement
    if not points:
        return ()
    common = set.intersection(*(set(by_entry) for by_entry in points.values()))
    return tuple(_average([by_entry[entry] for entry in sorted(common)]) for by_entry in points.values() if common)


def compare(rows: Sequence[RatedPoint], ours: str = OURS) -> tuple[Comparison, ...]:
    """Compare our curve with that of every other system that has at least two settings.

    Variants of one codec are compared at their common settings (values of lambda), because interpolation through
    different numbers of points would add a difference.
    """
    curves: dict[str, dict[str, RatedPoint]] = {}
    for row in rows:
        if row.kib and row.psnr is not None:
            curves.setdefault(row.system, {})[row.setting] = row
    if ours not in curves:
        return ()
    others = [name for name, curve in curves.items() if name != ours and len(curve) > 1]
    return tuple(_comparison(name, curves[name], curves[ours]) for name in others)


def _comparison(name: str, theirs: Mapping[str, RatedPoint], ours: Mapping[str, RatedPoint]) -> Comparison:
    shared = theirs.keys() & ours.keys()
    if len(shared) > 1:
        theirs, ours = ({setting: curve[setting] for setting in shared} for curve in (theirs, ours))
    curves = theirs.values(), ours.values()
    psnr = [[(row.kib, row.psnr) for row in curve if row.kib and row.psnr is not None] for curve in curves]
    # A smaller ST-LPIPS is better, and `bd_rate` expects a quality, of which more is better.
    st_lpips = [[(row.kib, -row.st_lpips) for row in curve if row.kib and row.st_lpips is not None] for curve in curves]
    return Comparison(name, bd_rate(*psnr), bd_psnr(*psnr), bd_rate(*st_lpips))


def _average(found: Sequence[Measurement]) -> Average:
    return Average(
        system=found[0].system,
        setting=found[0].setting,
        entries=len(found),
        kib=fmean(m.num_bytes for m in found) / 1024,
        bits_per_pixel=fmean(m.bits_per_pixel for m in found),
        gaussians=fmean(m.num_gaussians for m in found),
        psnr=fmean(m.psnr for m in found),
        ssim=fmean(m.ssim for m in found),
        ms_ssim=_mean_if_all([m.ms_ssim for m in found]),
        flip=_mean_if_all([m.flip for m in found]),
        st_lpips=_mean_if_all([m.st_lpips for m in found]),
        lpips=_mean_if_all([m.lpips for m in found]),
        context_psnr=fmean(m.context_psnr for m in found),
        encode_seconds=median(m.encode_seconds for m in found),
        decode_seconds=median(m.decode_seconds for m in found),
        peak_mib=max((m.peak_mib for m in found if m.peak_mib is not None), default=None),
    )


def _mean_if_all(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known and len(known) == len(values) else None


def as_tsv(rows: Sequence[Any]) -> str:
    """Format dataclass instances of one type as TSV: a header line, then one line per row.

    Floats have six significant digits; None is an empty cell.
    """
    if not rows:
        return ""
    lines = ["\t".join(asdict(rows[0]))]
    lines += ["\t".join(_cell(value) for value in asdict(row).values()) for row in rows]
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value).replace("\t", " ").replace("\n", " ")
