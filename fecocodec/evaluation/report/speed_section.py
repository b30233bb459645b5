"""Report section: time against quality at sender and receiver, and time per processing step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.section import Chart, Mark, Section, Series, number, pareto_front, picture, table
from fecocodec.evaluation.summary import OURS, Average, averages
from fecocodec.evaluation.systems.codec import ABLATION_NAMES

TEXT = """\
Medians over {entries} pairs of context views, after warm-up, in one process, on a CPU, without rendering; in brackets
the quartiles. PSNR and time of each curve are those at {kib:.1f} KiB, interpolated over the logarithm of the file size.
A curve that does not cover this size is shown at its nearest end, and left out if that is not within a factor of two.
Variants of our codec:

- *effort fast*; *one thread*;
- *bfloat16*: convolutions and attention at both ends; no option of the commands;
- *half the size*: photographs of half the width and height are encoded, the Gaussians are rendered at full size.

Gaussian files and photographs are coded by third-party libraries; the receiver time for photographs includes our
networks.

{sender}

{receiver}

{equal}

All operating points, at different rates:

{sender_all}

{receiver_all}

Time by step, two views of {side}x{side} pixels at lambda 1e-3, after warm-up:

{steps}
"""
ENDS = {"sender": "encode_seconds", "receiver": "decode_seconds"}
QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class AtEqualRate:
    """A system at one file size. seconds: quartiles, by end."""

    system: str
    kib: float
    psnr: float
    seconds: dict[str, list[float]]


def speed_section(
    rate: Sequence[Measurement], speed: Sequence[Measurement], steps: dict[str, dict[str, float]], side: int
) -> Section:
    """Return the section. rate: measurements of all systems, of which those on the entries of `speed` are shown.

    steps: seconds by processing step, for encoding and decoding. side: image side of `steps` in pixels.
    """
    entries = {m.entry for m in speed}
    own = {m.system for m in speed} | set(ABLATION_NAMES)
    others = [m for m in rate if m.entry in entries and m.system not in own and m.num_bytes]
    rows = averages([*speed, *others])
    if not rows:
        return Section("Speed and quality", "Nothing could be measured.")
    sizes = sorted(row.kib for row in rows if row.system == OURS)
    kib = sizes[len(sizes) // 2]
    at_kib = _at_equal_rate(rows, [*speed, *others], kib)
    equal = [_equal_rate(at_kib, kib, end) for end in ENDS]
    every = [_all_points(rows, *end) for end in ENDS.items()]
    text = TEXT.format(
        entries=rows[0].entries,
        kib=kib,
        side=side,
        sender=picture(equal[0]),
        receiver=picture(equal[1]),
        equal=_equal_table(at_kib),
        sender_all=picture(every[0]),
        receiver_all=picture(every[1]),
        steps=_steps(steps),
    )
    return Section("Speed and quality", text, (*equal, *every))


def _at_equal_rate(rows: Sequence[Average], found: Sequence[Measurement], kib: float) -> list[AtEqualRate]:
    """Return the systems that come within a factor of two of this size. found: the measurements of the rows."""
    systems = []
    for name in dict.fromkeys(row.system for row in rows):
        own = sorted((row for row in rows if row.system == name), key=lambda row: row.kib)
        rates = np.log([row.kib for row in own])
        nearest = min(max(kib, own[0].kib), own[-1].kib)
        if not kib / 2 <= nearest <= 2 * kib:
            continue
        seconds = {}
        for end, field in ENDS.items():
            of_rows = [
                np.quantile([getattr(m, field) for m in found if _point(m) == _point(row) and not m.error], QUARTILES)
                for row in own
            ]
            seconds[end] = [float(np.interp(np.log(kib), rates, values)) for values in zip(*of_rows, strict=True)]
        psnr = float(np.interp(np.log(kib), rates, [row.psnr for row in own]))
        systems.append(AtEqualRate(name, nearest, psnr, seconds))
    return systems


def _point(of: Average | Measurement) -> tuple[str, str]:
    return of.system, of.setting


def _equal_rate(systems: Sequence[AtEqualRate], kib: float, end: str) -> Chart:
    series = []
    for system in systems:
        low, middle, high = system.seconds[end]
        note = f"at {system.kib:.1f} KiB, {low:.3g} to {high:.3g} s"
        series.append(Series(system.system, (Mark(max(middle, 1e-4), system.psnr, note),), is_line=False))
    return _chart(end, "speed", f" at about {kib:.1f} KiB", series)


def _chart(end: str, name: str, subtitle: str, series: Sequence[Series]) -> Chart:
    """Return the chart of PSNR against the seconds at one end, with its Pareto front."""
    front = pareto_front(mark for one in series for mark in one.marks)
    title, label = f"Speed of the {end} and quality{subtitle}", f"seconds at the {end}"
    return Chart(f"{end}_{name}", title, label, "PSNR of target views, dB", tuple(series), True, front=front)


def _equal_table(systems: Sequence[AtEqualRate]) -> str:
    rows = []
    for system in systems:
        times = [f"{middle:.3f} ({low:.3f} to {high:.3f})" for low, middle, high in system.seconds.values()]
        rows.append((system.system, number(system.kib, 1), number(system.psnr), *times))
    return table(("system", "KiB", "PSNR of targets", *(f"{end}, s" for end in ENDS)), rows)


def _all_points(rows: Sequence[Average], end: str, field: str) -> Chart:
    curves: dict[str, list[Mark]] = {}
    for row in rows:
        mark = Mark(max(getattr(row, field), 1e-4), row.psnr, f"{row.setting}, {row.kib:.1f} KiB")
        curves.setdefault(row.system, []).append(mark)
    series = [Series(name, tuple(marks)) for name, marks in curves.items()]
    return _chart(end, "points", ", all operating points", series)


def _steps(steps: dict[str, dict[str, float]]) -> str:
    rows = []
    for end, seconds in steps.items():
        total = sum(seconds.values())
        large = {step: took for step, took in seconds.items() if took / total >= 0.005}
        parts = (f"{step}: {1e3 * took:.0f} ({took / total:.0%})" for step, took in large.items())
        rows.append((end, number(1e3 * total, 0), "; ".join(parts)))
    return table(("end", "ms", "steps"), rows)
