"""Results in the layout of the paper: curves of quality against rate, and its Table 1 (parameters, latency, memory).

Results of other systems are those that the paper prints, or come from a CSV file.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError
from fecocodec.evaluation.report.section import Chart, Mark, Series, number, table
from fecocodec.evaluation.summary import OURS, Average, ExternalRow, RatedPoint
from fecocodec.input_file import require_regular_file
from fecocodec.sender.codec import Codec
from fecocodec.sender.parameters import PUBLISHED as PUBLISHED_PARAMETERS
from fecocodec.sender.parameters import RECEIVER_SUM, SENDER_SUM, count_parameters, parameter_table

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


_PARAMETERS = PUBLISHED_PARAMETERS["paper"]
# What the paper prints (Table 1; Base: its appendix): parameters of sender and receiver in millions, seconds of both,
# peak memory in GiB. None: not printed. NaN: "N/A", because HEVC has no trained parameters.
PUBLISHED: dict[str, tuple[float | None, ...]] = {
    "ELIC -> DepthSplat": (26.45, 62.40, 0.077, 0.181, 1.505),
    "ELIC -> ReSplat": (26.45, 100.69, 0.074, 0.305, 2.119),
    "DepthSplat -> TinySplat": (38.34, math.nan, 1.285, 0.375, 1.365),
    "DepthSplat -> FCGS": (40.87, 2.05, 2.035, 0.821, 4.706),
    "ReSplat -> TinySplat": (76.63, math.nan, 1.448, 0.497, 1.925),
    "ReSplat -> FCGS": (79.16, 2.05, 2.319, 0.784, 5.157),
    "CodecSplat": (181.73, 45.00, 0.189, 0.138, 2.065),
    "FeCoSplat": (_PARAMETERS[SENDER_SUM] / 1e6, _PARAMETERS[RECEIVER_SUM] / 1e6, 0.168, 0.117, 1.316),
    "ELIC -> DepthSplat (Base)": (26.45, 144.81, None, None, None),
    "ELIC -> ReSplat (Base)": (26.45, 246.20, None, None, None),
}
_COSTS = ("sender_params", "receiver_params", "encode_seconds", "decode_seconds", "peak_gib")
# Parts of other systems that are in this repository -> profile of `parameter_table`, what is ours in its extractor.
_COUNTED = {
    "DepthSplat-Small, features": ("paper", ()),
    "DepthSplat-Base, features": ("paper-large", ("input", "blocks")),
}
_HEAD = ("method", "sender, M parameters", "receiver, M", "sender, s", "receiver, s", "peak memory, GiB", "source")
_LEGEND = """
*published*: by the paper, of a GPU and pairs of RealEstate10K. *counted*: parameters of our implementation, without
Gaussian heads. *external*: of the given file.
"""
METRICS: dict[str, str] = {
    "psnr": "PSNR of target views, dB",
    "ssim": "SSIM of target views",
    "st_lpips": "ST-LPIPS (AlexNet) of target views",
    "lpips": "LPIPS (VGG16) of target views",
    "lpips_alex": "LPIPS (AlexNet) of target views",
}


def quality_charts(rows: Sequence[Average], external: Sequence[ExternalRow]) -> tuple[Chart, ...]:
    """Return one chart per metric that was measured, with the curves of our systems and of the external ones."""
    charts = []
    every: tuple[RatedPoint, ...] = (*rows, *external)
    for metric, label in METRICS.items():
        curves: dict[str, list[Mark]] = {}
        for row in every:
            if row.kib and (quality := getattr(row, metric)) is not None:
                curves.setdefault(row.system, []).append(Mark(row.kib, quality, row.setting))
        series = (Series(name, tuple(sorted(marks, key=lambda mark: mark.x))) for name, marks in curves.items())
        if curves:
            charts.append(Chart(f"curves_{metric}", label, "KiB a scene", label, tuple(series), has_log_x=True))
    return tuple(charts)


def complexity_table(codec: Codec, rows: Sequence[Average], external: Sequence[ExternalRow]) -> str:
    """Return the paper's Table 1 in Markdown: the rows of `others`, then ours.

    Our latency and memory are the largest over the settings of the codec (resident memory on a CPU, allocated memory
    on a CUDA device).
    """
    return cost_table([*others(external), cost_line(_ours(codec, [row for row in rows if row.system == OURS]))])


def cost_table(lines: Sequence[tuple[str, ...]]) -> str:
    """Return these lines of `cost_line` in the layout of the paper's Table 1, in Markdown, and what their source is."""
    return table(_HEAD, lines) + "\n" + _LEGEND


def cost_line(row: ExternalRow, source: str = "measured") -> tuple[str, ...]:
    """Return the cells of a system: "" for what is not known, "N/A" for NaN."""
    digits = dict.fromkeys(_COSTS, 3) | {"sender_params": 2, "receiver_params": 2}
    values = ((getattr(row, name), digits[name]) for name in _COSTS)
    cells = ("" if value is None else "N/A" if math.isnan(value) else number(value, most) for value, most in values)
    return row.system, *cells, source


def others(external: Sequence[ExternalRow]) -> list[tuple[str, ...]]:
    """Return the lines of other systems: PUBLISHED, replaced where `external` has costs; its others; what we count."""
    rows = {name: (costs_of(name, values), "published") for name, values in PUBLISHED.items()}
    has_costs = (row for row in external if any(getattr(row, name) is not None for name in _COSTS))
    rows |= {row.system: (row, "external") for row in has_costs}
    rows |= {name: (costs_of(name, (_counted(*of),)), "counted") for name, of in _COUNTED.items() if name not in rows}
    return [cost_line(*row) for row in rows.values()]


def costs_of(system: str, values: Sequence[float | None]) -> ExternalRow:
    """Return the row of a system with these costs, in the order of `PUBLISHED`; what is left out is not known."""
    costs: dict[str, Any] = dict(zip(_COSTS, values, strict=False))
    return ExternalRow(system, **costs)


def params_of_ends(codec: Codec) -> tuple[float, float]:
    """Return the millions of parameters that sender and receiver load; the sender also loads those of the receiver."""
    receiver = count_parameters(codec.receiver) / 1e6
    return receiver + count_parameters(codec.sender) / 1e6, receiver


@cache
def _counted(profile: str, ours: tuple[str, ...]) -> float:
    rows = (row for row in parameter_table(profile) if row.module.startswith("extractor."))
    return sum(row.parameters for row in rows if row.module.removeprefix("extractor.") not in ours) / 1e6


def _ours(codec: Codec, rows: Sequence[Average]) -> ExternalRow:
    peak = max((row.peak_mib / 1024 for row in rows if row.peak_mib is not None), default=None)
    encoding = max((row.encode_seconds for row in rows), default=None)
    decoding = max((row.decode_seconds for row in rows), default=None)
    return costs_of(OURS, (*params_of_ends(codec), encoding, decoding, peak))
