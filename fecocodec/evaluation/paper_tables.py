"""Results in the layout of the paper: curves of quality against rate, and its Table 1 (parameters, latency, memory).

Results of other systems, measured elsewhere, come from a CSV file.
"""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from fecocodec.errors import InputError
from fecocodec.evaluation.report.section import Chart, Mark, Series, number, table
from fecocodec.evaluation.summary import OURS, Average
from fecocodec.input_file import require_regular_file
from fecocodec.sender.codec import Codec
from fecocodec.sender.parameters import count_parameters


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


COLUMNS = tuple(field.name for field in fields(ExternalRow))
_TEXTS = ("system", "setting")


def read_external(path: Path) -> tuple[ExternalRow, ...]:
    """Read a CSV file whose header is `system` and any other of COLUMNS; empty cells are not measured.

    Raises InputError for another column, a row without a name, and a cell that is no finite number.
    """
    try:
        require_regular_file(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            unknown = [name for name in reader.fieldnames or () if name not in COLUMNS]
            if unknown or "system" not in (reader.fieldnames or ()):
                raise InputError(f"{path}: its columns must be among {', '.join(COLUMNS)}, with system; name them so.")
            return tuple(_row(path, number, row) for number, row in enumerate(reader, start=2))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV file that can be read ({error}); check the path and the file.") from error


def _row(path: Path, line: int, cells: dict[str | None, str | None]) -> ExternalRow:
    if None in cells or None in cells.values() or not cells["system"]:
        raise InputError(f"{path}, line {line}: has no system, or not one cell a column; correct the line.")
    texts = {name: cells[name] or "" for name in _TEXTS if name in cells}
    numbers = {name: _number(path, line, name, cells.get(name) or "") for name in COLUMNS if name not in _TEXTS}
    return ExternalRow(**texts, **numbers)  # type: ignore[arg-type]


def _number(path: Path, line: int, name: str, text: str) -> float | None:
    if not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}, line {line}: {name} is {text!r}, not a number; leave it empty if it is not known.")
    return value


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
    "lpips": "LPIPS (VGG16) of target views",
    "lpips_alex": "LPIPS (AlexNet) of target views",
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
    receiver = count_parameters(codec.receiver)
    sender = receiver + count_parameters(codec.sender)
    peaks = [row.peak_mib / 1024 for row in rows if row.peak_mib is not None]
    values = (_largest(rows, lambda row: row.encode_seconds), _largest(rows, lambda row: row.decode_seconds))
    cells = ("" if value is None else number(value, 3) for value in (*values, max(peaks, default=None)))
    return OURS, number(sender / 1e6), number(receiver / 1e6), *cells


def _largest(rows: Sequence[Average], value: Callable[[Average], float]) -> float | None:
    return max((value(row) for row in rows), default=None)
