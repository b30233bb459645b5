"""Report sections: rate and quality of the codec, of alternatives, and of ablations."""

from collections.abc import Sequence

from fecocodec.evaluation.bd_rate import SIZES_KIB, Gain, gain_at
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.section import Chart, Mark, Section, Series, number, picture, table
from fecocodec.evaluation.summary import NO_LPIPS, OURS, Average, averages
from fecocodec.evaluation.systems.codec import ABLATION_NAMES, BEST, FAST
from fecocodec.evaluation.systems.trivial_baselines import NEAREST

TEXT = """\
Means over {entries} pairs of context views. Baselines:

- *JPEG XL*, *AVIF*, *JPEG*: the sender transmits compressed context views, and the receiver computes Gaussians
  with our networks, those of the sender included. *optimised at the receiver*: it also optimises the latents towards
  the decoded photographs, as our encoder does. AVIF is counted without its containers.
- *Gaussians as HEVC*, *SPZ*: the sender transmits our Gaussians, from optimised latents without coding. HEVC (x265)
  codes their attributes as images; SPZ is smaller where more of them are merged.
- *nearest view*: a copy of the nearest context view (not drawn). *best plane*: both context views, warped by the plane
  that fits the target view best.

{chart}

{equal_bytes_text} *{best}*, below, is `encode --effort best`.

{equal_bytes}

{averages}
"""
ABLATION_TEXT = """\
A part is removed at inference without retraining, which shows how much the trained networks depend on it. *effort fast*
omits the optimisation of the latents. Parts that need retraining are in [what_we_learned.md](what_we_learned.md).

{chart}

{equal_bytes}
"""
EQUAL_BYTES_TEXT = """\
PSNR of target views at equal bytes, ours minus that of each baseline, in dB, with 95% intervals by bootstrap over
scenes. Our files have the given size on average; each pair is compared at the size of its own file."""


def rate_sections(found: Sequence[Measurement], more_views: Sequence[Measurement]) -> tuple[Section, ...]:
    """Return the sections on rate and quality, ablations, and entries with more than two context views."""
    rows = averages(found)
    parts_left_out = (*ABLATION_NAMES, FAST)
    main = [row for row in rows if row.system not in parts_left_out]
    ablated = [row for row in rows if row.system in (OURS, *parts_left_out)]
    drawn = curves_of([row for row in main if row.system != NEAREST])  # its PSNR would compress the axis
    chart = Chart("rate_distortion", "Rate and quality", "KiB a scene", "PSNR of target views, dB", drawn, True)
    parts = Chart("ablations", "Without some part", "KiB a scene", "PSNR of target views, dB", curves_of(ablated), True)
    text = TEXT.format(
        entries=max((row.entries for row in rows), default=0),
        chart=picture(chart),
        averages=_averages(main),
        best=BEST,
        equal_bytes_text=EQUAL_BYTES_TEXT,
        equal_bytes=equal_bytes_table(found, [row.system for row in main if row.system != BEST]),
    )
    equal_bytes = equal_bytes_table(found, [row.system for row in ablated])
    without = ABLATION_TEXT.format(chart=picture(parts), equal_bytes=equal_bytes)
    views = Section("More than two views", _by_views(more_views))
    return Section("Rate and quality", text, (chart,)), Section("Without some part", without, (parts,)), views


def curves_of(rows: Sequence[Average]) -> tuple[Series, ...]:
    """Return one series per system. A system that transmits nothing is drawn as a horizontal line."""
    rates = [row.kib for row in rows if row.kib > 0]
    series = []
    for name in dict.fromkeys(row.system for row in rows):
        own = sorted((row for row in rows if row.system == name), key=lambda row: row.kib)
        marks = [Mark(row.kib, row.psnr, row.setting) for row in own if row.kib > 0]
        level = [Mark(rate, own[0].psnr, own[0].setting) for rate in (min(rates), max(rates))]
        series.append(Series(name, tuple(marks or level)))
    return tuple(series)


def equal_bytes_table(found: Sequence[Measurement], systems: Sequence[str], *variants: str) -> str:
    """Return a table of our gain, and that of our variants, over each of these systems at SIZES_KIB."""
    heads = [f"{ours} at {kib:g} KiB" for ours in (OURS, *variants) for kib in SIZES_KIB]
    lines = []
    for baseline in dict.fromkeys(systems):
        gains = [gain_at(found, baseline, kib, ours) for ours in (OURS, *variants) for kib in SIZES_KIB]
        if baseline not in (OURS, *variants) and any(gains):
            lines.append((baseline, *map(_gain_cell, gains)))
    return table(("against", *heads), lines)


def _gain_cell(gain: Gain | None) -> str:
    if gain is None:
        return "-"
    count = "" if gain.pairs == gain.measured else f", {gain.pairs} of {gain.measured}"
    return f"{gain.db:+.2f} ({gain.low:+.2f} to {gain.high:+.2f}{count})"


def _averages(rows: Sequence[Average]) -> str:
    """Return a table of all measures, and one sentence where the weights of LPIPS (VGG16) are missing."""
    digits = {"kib": 2, "psnr": 2, "ssim": 3, "st_lpips": 3, "lpips": 3, "lpips_alex": 3}
    cells = [(r.system, r.setting, *(number(getattr(r, name), n) for name, n in digits.items())) for r in rows]
    text = table(("system", "setting", "KiB", "PSNR", "SSIM", "ST-LPIPS", "LPIPS", "LPIPS (AlexNet)"), cells)
    return text if any(row.lpips is not None for row in rows) else f"{text}\n\n{NO_LPIPS}"


def _by_views(found: Sequence[Measurement]) -> str:
    head = ("entry", "views", "size", "KiB", "PSNR of targets", "PSNR of context", "encode, s", "decode, s")
    rows = []
    for m in (m for m in found if not m.error):
        values = (m.num_bytes / 1024, m.psnr, m.context_psnr, m.encode_seconds, m.decode_seconds)
        rows.append((m.entry, f"{m.num_context}", f"{m.width}x{m.height}", *map(number, values)))
    return f"At lambda 1e-3; single measurements.\n\n{table(head, rows)}" if rows else "The index has no such entries."
