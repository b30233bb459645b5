"""No more than a scene needs: bytes and Gaussians against complexity, and what adaptive decisions save."""

from collections.abc import Mapping, Sequence
from statistics import fmean

from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.section import Section, number, picture, table
from fecocodec.evaluation.stress.complexity import LAMBDA, Need
from fecocodec.evaluation.summary import OURS, averages, compare
from fecocodec.evaluation.systems.adaptive_systems import ADAPTIVE, ALL_GAUSSIANS, PRUNED
from fecocodec.evaluation.systems.codec import THOROUGH
from fecocodec.sender.refinement import DEFAULT_STEPS, MANY_STEPS

LEAST_FEWER_GAUSSIANS, LARGEST_LOSS_DB = 20.0, 0.05  # what the project asks for
LEAST_FEWER_BYTES = 10.0  # percent, on the simplest third
TEXT = """\
Complexity is the size of the context photographs as JPEG XL at distance 1. Files and Gaussians are those of the
adaptive sender at lambda 1e-3: of drawn rooms, from bare walls to {waves} patterns over each other, and of photographs.

{bytes_chart}

{gaussians_chart}

What the decisions save. Gaussians: the same adaptive files at lambda 1e-3, against all that they could emit. Bytes:
adaptive files against plain ones at equal PSNR of target views (BD-rate), on thirds of the entries by complexity. The
adaptive sender takes {steps} steps of refinement, the plain one {few} (more at small lambdas); against plain files of
as many steps, which were made of fewer entries, is what remains for its decisions.

{gaussians}

{bytes}
"""


def adaptive_section(
    rate: Sequence[Measurement],
    savings: Sequence[Measurement],
    complexity: Mapping[str, float],
    needs: Sequence[Need],
) -> Section:
    """rate: of some pairs and every system; savings: of more pairs, plain and adaptive; complexity: KiB of the
    photographs of these by entry; needs: of drawn rooms."""
    at_lambda = [m for m in savings if m.system == ADAPTIVE and m.setting == f"lambda {LAMBDA:g}" and not m.error]
    photographs = [(m, complexity[m.entry]) for m in at_lambda]
    kib = Chart(
        "complexity_bytes",
        "Bytes and complexity",
        "KiB of the photographs as JPEG XL",
        "KiB of the file",
        (
            Series("rooms", tuple(Mark(n.photograph_kib, n.kib, _note(n)) for n in needs)),
            Series("photographs", tuple(Mark(x, m.num_bytes / 1024, m.entry) for m, x in photographs), is_line=False),
        ),
    )
    gaussians = Chart(
        "complexity_gaussians",
        "Gaussians and complexity",
        "KiB of the photographs as JPEG XL",
        "Gaussians a context pixel",
        (
            Series("photographs", tuple(Mark(x, _density(m), m.entry) for m, x in photographs), is_line=False),
            Series("rooms", tuple(Mark(n.photograph_kib, n.gaussians_per_pixel, _note(n)) for n in needs)),
        ),
    )
    text = TEXT.format(
        steps=MANY_STEPS,
        few=DEFAULT_STEPS,
        waves=max((n.num_waves for n in needs), default=0),
        bytes_chart=picture(kib),
        gaussians_chart=picture(gaussians),
        gaussians=_gaussians_saved(rate),
        bytes=_bytes_saved(rate, savings, complexity),
    )
    return Section("No more than a scene needs", text, (kib, gaussians))


def _note(need: Need) -> str:
    return f"{need.num_waves} patterns, {need.num_stages} stages"


def _density(measurement: Measurement) -> float:
    return measurement.num_gaussians / (measurement.num_context * measurement.height * measurement.width)


def _gaussians_saved(found: Sequence[Measurement]) -> str:
    """By who leaves them out: means over entries."""
    every = {(m.entry, m.setting): m for m in found if m.system == ALL_GAUSSIANS and not m.error}
    rows = []
    for name, label in ((ADAPTIVE, "sender, keep section"), (PRUNED, "receiver too, decode --prune")):
        pairs = [
            (every[m.entry, m.setting], m)
            for m in found
            if m.system == name and (m.entry, m.setting) in every and not m.error
        ]
        if not pairs:
            continue
        saved = fmean(100 * (1 - kept.num_gaussians / whole.num_gaussians) for whole, kept in pairs)
        losses = [whole.psnr - kept.psnr for whole, kept in pairs]
        context = fmean(whole.context_psnr - kept.context_psnr for whole, kept in pairs)
        is_met = saved >= LEAST_FEWER_GAUSSIANS and fmean(losses) < LARGEST_LOSS_DB
        numbers = (number(saved, 1), number(fmean(losses), 3), number(max(losses), 3), number(context, 3))
        rows.append((label, *numbers, "met" if is_met else "missed"))
    head = (
        "left out by",
        "fewer Gaussians, %",
        "loss of target views, dB",
        "the most of an entry",
        "loss of context views",
        f"at least {LEAST_FEWER_GAUSSIANS:.0f}% at under {LARGEST_LOSS_DB} dB",
    )
    return table(head, rows)


def _bytes_saved(rate: Sequence[Measurement], savings: Sequence[Measurement], complexity: Mapping[str, float]) -> str:
    """Adaptive files against plain ones, of every pair, and against those of as many steps, of fewer: by thirds."""
    rows = []
    for other, label, found in ((OURS, "plain", savings), (THOROUGH, "as many steps", rate)):
        curves = [m for m in found if m.system in (other, ADAPTIVE)]
        compared = {m.entry for m in curves if m.system == other} & complexity.keys()
        order = sorted(compared, key=lambda entry: complexity[entry])
        count = -(-len(order) // 3)
        thirds = {"simplest third": order[:count], "other entries": order[count:], "all": order}
        for name, entries in thirds.items():
            if not entries:
                continue
            (comparison, *_) = compare(averages([m for m in curves if m.entry in entries]), ours=ADAPTIVE) or (None,)
            saved = comparison.bd_rate if comparison else None
            gain = comparison.bd_psnr if comparison else None
            is_asked = name == "simplest third" and other == OURS
            is_met = saved is not None and saved <= -LEAST_FEWER_BYTES
            verdict = ("met" if is_met else "missed") if is_asked else ""
            rows.append((name, f"{len(entries)}", label, number(saved, 1), number(gain), verdict))
    head = (
        "entries",
        "number",
        "against",
        "bytes at equal PSNR, %",
        "PSNR at equal bytes, dB",
        f"at least {LEAST_FEWER_BYTES:.0f}% fewer",
    )
    return table(head, rows)
