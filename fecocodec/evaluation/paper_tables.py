"""Results in the layout of the paper: curves of quality against rate, and its Table 1 (parameters, latency, memory)."""

from collections.abc import Callable, Sequence

from fecocodec.evaluation.external import ExternalRow
from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.section import number, table
from fecocodec.evaluation.summary import OURS, Average
from fecocodec.sender.codec import Codec

# The baselines of the paper's Table 1. Their cells stay empty until an external file has them.
BASELINES = (
    "ELIC -> DepthSplat",
    "ELIC -> ReSplat",
    "DepthSplat -> TinySplat",
    "DepthSplat -> FCGS",
    "ReSplat -> TinySplat",
    "ReSplat -> FCGS",
    "CodecSplat",
)
METRICS: dict[str, str] = {
    "psnr": "PSNR of target views, dB",
    "ssim": "SSIM of target views",
    "st_lpips": "ST-LPIPS (AlexNet) of target views",
    "lpips": "LPIPS (VGG-16) of target views",
}
_HEAD = ("method", "sender, M parameters", "receiver, M", "sender, s", "receiver, s", "peak memory, GiB")


def quality_charts(rows: Sequence[Average], external: Sequence[ExternalRow]) -> tuple[Chart, ...]:
    """Return one chart per metric that was measured, with the curves of our systems and of the external ones."""
    charts = []
    every: tuple[Average | ExternalRow, ...] = (*rows, *external)
    for metric, label in METRICS.items():
        points = [_point(row, metric) for row in every]
        found = [point for point in points if point is not None]
        names = dict.fromkeys(name for name, _ in found)
        series = tuple(_series(name, [mark for other, mark in found if other == name]) for name in names)
        if series:
            charts.append(Chart(f"curves_{metric}", label, "KiB a scene", label, series, has_log_x=True))
    return tuple(charts)


def complexity_table(codec: Codec, rows: Sequence[Average], external: Sequence[ExternalRow]) -> str:
    """Return the paper's Table 1 in Markdown: the baselines, other external systems, then ours.

    Our latency and memory are the largest over the settings of the codec (resident memory on a CPU, allocated memory
    on a CUDA device). A cell that nobody measured is empty.
    """
    measured = {row.system: row for row in external if _is_complexity(row)}
    others = [name for name in measured if name not in BASELINES]
    lines = [_external_line(name, measured.get(name)) for name in (*BASELINES, *others)]
    return table(_HEAD, [*lines, _our_line(codec, [row for row in rows if row.system == OURS])]) + "\n"


def _point(row: Average | ExternalRow, metric: str) -> tuple[str, Mark] | None:
    quality = getattr(row, metric)
    if not row.kib or quality is None:
        return None
    return row.system, Mark(row.kib, quality, row.setting)


def _series(name: str, marks: list[Mark]) -> Series:
    return Series(name, tuple(sorted(marks, key=lambda mark: mark.x)))


def _is_complexity(row: ExternalRow) -> bool:
    return any(value is not None for value in _numbers(row))


def _numbers(row: ExternalRow) -> tuple[float | None, ...]:
    return row.sender_params, row.receiver_params, row.encode_seconds, row.decode_seconds, row.peak_gib


def _external_line(name: str, row: ExternalRow | None) -> tuple[str, ...]:
    values: tuple[float | None, ...] = (None,) * 5 if row is None else _numbers(row)
    return name, *("" if value is None else number(value, 3) for value in values)


def _our_line(codec: Codec, rows: Sequence[Average]) -> tuple[str, ...]:
    receiver = sum(parameter.numel() for parameter in codec.receiver.parameters())
    sender = receiver + sum(parameter.numel() for parameter in codec.sender.parameters())
    peaks = [row.peak_mib / 1024 for row in rows if row.peak_mib is not None]
    values = (_largest(rows, lambda row: row.encode_seconds), _largest(rows, lambda row: row.decode_seconds))
    cells = ("" if value is None else number(value, 3) for value in (*values, max(peaks, default=None)))
    return OURS, number(sender / 1e6), number(receiver / 1e6), *cells


def _largest(rows: Sequence[Average], value: Callable[[Average], float]) -> float | None:
    return max((value(row) for row in rows), default=None)
