"""Averages over entries, and comparisons of rate-distortion curves, as rows of tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from statistics import fmean, median
from typing import Any

from fecocodec.evaluation.bd_rate import bd_psnr, bd_rate
from fecocodec.evaluation.records import Measurement

OURS = "fecosplat"
NO_LPIPS = "LPIPS (VGG16) was not measured: its weights are in a clone of the repository only, not in a wheel."
LEAST_OVERLAP_DB = 0.5  # of two curves; a BD-rate over less depends on single points


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
    lpips_alex: float | None
    context_psnr: float
    encode_seconds: float
    decode_seconds: float
    peak_mib: float | None


@dataclass(frozen=True)
class ExternalRow:
    """One operating point of another system. Only the name is required; None: not measured.

    kib: size of a scene. psnr in dB. sender_params, receiver_params: in millions. encode_seconds, decode_seconds: per
    scene. peak_gib: peak memory in GiB.
    """

    system: str
    setting: str = ""
    kib: float | None = None
    psnr: float | None = None
    ssim: float | None = None
    st_lpips: float | None = None
    lpips: float | None = None
    lpips_alex: float | None = None
    sender_params: float | None = None
    receiver_params: float | None = None
    encode_seconds: float | None = None
    decode_seconds: float | None = None
    peak_gib: float | None = None


RatedPoint = Average | ExternalRow  # of a rate-distortion curve


@dataclass(frozen=True)
class Comparison:
    """BD metrics of our curve against that of a baseline. None: the curves do not overlap, or a metric is missing.

    bd_rate: percent, at equal PSNR; None if the curves share less than LEAST_OVERLAP_DB. bd_psnr: dB.
    bd_rate_st_lpips: percent, at equal ST-LPIPS.
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


def compare(rows: Sequence[RatedPoint]) -> tuple[Comparison, ...]:
    """Compare our curve with that of every other system that has at least two settings.

    Variants of one codec are compared at their common settings (values of lambda), because interpolation through
    different numbers of points would add a difference.
    """
    curves: dict[str, dict[str, RatedPoint]] = {}
    for row in rows:
        if row.kib and row.psnr is not None:
            curves.setdefault(row.system, {})[row.setting] = row
    if OURS not in curves:
        return ()
    others = [name for name, curve in curves.items() if name != OURS and len(curve) > 1]
    return tuple(_comparison(name, curves[name], curves[OURS]) for name in others)


def _comparison(name: str, theirs: Mapping[str, RatedPoint], ours: Mapping[str, RatedPoint]) -> Comparison:
    shared = theirs.keys() & ours.keys()
    if len(shared) > 1:
        theirs, ours = ({setting: curve[setting] for setting in shared} for curve in (theirs, ours))
    curves = theirs.values(), ours.values()
    psnr = [[(row.kib, row.psnr) for row in curve if row.kib and row.psnr is not None] for curve in curves]
    # A smaller ST-LPIPS is better, and `bd_rate` expects a quality, of which more is better.
    st_lpips = [[(row.kib, -row.st_lpips) for row in curve if row.kib and row.st_lpips is not None] for curve in curves]
    return Comparison(name, bd_rate(*psnr, least_overlap=LEAST_OVERLAP_DB), bd_psnr(*psnr), bd_rate(*st_lpips))


def _average(found: Sequence[Measurement]) -> Average:
    names = ["bits_per_pixel", "psnr", "ssim", "ms_ssim", "flip", "st_lpips", "lpips", "lpips_alex", "context_psnr"]
    means: dict[str, Any] = {name: _mean_if_all([getattr(m, name) for m in found]) for name in names}
    return Average(
        system=found[0].system,
        setting=found[0].setting,
        entries=len(found),
        kib=fmean(m.num_bytes for m in found) / 1024,
        gaussians=fmean(m.num_gaussians for m in found),
        **means,
        encode_seconds=median(m.encode_seconds for m in found),
        decode_seconds=median(m.decode_seconds for m in found),
        peak_mib=max((m.peak_mib for m in found if m.peak_mib is not None), default=None),
    )


def _mean_if_all(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known and len(known) == len(values) else None


def as_tsv(rows: Sequence[Any]) -> str:
    """Format dataclass instances of one type as TSV with a head line: floats with six digits, None as empty cells."""
    return _lines(asdict(rows[0]), [asdict(row).values() for row in rows]) if rows else ""


def summary_tsv(rows: Sequence[Average], external: Sequence[ExternalRow]) -> str:
    """Format averages as `as_tsv` does, and below them other systems, whose number of entries is "external"."""
    names = [field.name for field in fields(Average)]
    defaults = dict.fromkeys(names) | {"entries": "external"}
    return _lines(names, [[getattr(row, name, defaults[name]) for name in names] for row in (*rows, *external)])


def _lines(head: Iterable[str], rows: Sequence[Iterable[object]]) -> str:
    return "".join("\t".join(map(_cell, cells)) + "\n" for cells in (head, *rows))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value).replace("\t", " ").replace("\n", " ")
