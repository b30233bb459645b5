"""Report section: file size and number of Gaussians against scene complexity, and the effect of `decode --prune`."""

from collections.abc import Mapping, Sequence
from statistics import fmean

from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.section import Section, number, picture, table
from fecocodec.evaluation.stress.complexity import LAMBDA, Need
from fecocodec.evaluation.summary import OURS
from fecocodec.evaluation.systems.pruned import PRUNED

LEAST_FEWER_GAUSSIANS, LARGEST_LOSS_DB = 20.0, 0.05  # required by the project
TEXT = """\
Complexity is the size of the context views as JPEG XL at distance 1. Files at lambda 1e-3, of photographs and of
synthetic rooms whose walls have no pattern or the sum of up to {waves} patterns.

{bytes_chart}

{gaussians_chart}

`decode --prune` at lambda 1e-3:

{pruning}
"""


def complexity_section(
    rate: Sequence[Measurement],
    photographs: Sequence[Measurement],
    complexity: Mapping[str, float],
    needs: Sequence[Need],
) -> Section:
    """Return the section.

    rate: measurements of all systems, including the pruned one. photographs: measurements of more pairs at one lambda.
    complexity: size of the context views in KiB, by entry of `photographs`. needs: measurements of synthetic rooms.
    """
    at_lambda = [m for m in photographs if m.system == OURS and m.setting == f"lambda {LAMBDA:g}" and not m.error]
    shown = [(m, complexity[m.entry]) for m in at_lambda]
    kib = Chart(
        "complexity_bytes",
        "Bytes and complexity",
        "KiB of the photographs as JPEG XL",
        "KiB of the file",
        (
            Series("rooms", tuple(Mark(n.photograph_kib, n.kib, _note(n)) for n in needs)),
            Series("photographs", tuple(Mark(x, m.num_bytes / 1024, m.entry) for m, x in shown), is_line=False),
        ),
    )
    gaussians = Chart(
        "complexity_gaussians",
        "Gaussians and complexity",
        "KiB of the photographs as JPEG XL",
        "Gaussians a context pixel",
        (
            Series("photographs", tuple(Mark(x, _density(m), m.entry) for m, x in shown), is_line=False),
            Series("rooms", tuple(Mark(n.photograph_kib, n.gaussians_per_pixel, _note(n)) for n in needs)),
        ),
    )
    text = TEXT.format(
        waves=max((n.num_waves for n in needs), default=0),
        bytes_chart=picture(kib),
        gaussians_chart=picture(gaussians),
        pruning=_pruning(rate),
    )
    return Section("Bytes, Gaussians and complexity", text, (kib, gaussians))


def _note(need: Need) -> str:
    return f"{need.num_waves} patterns"


def _density(measurement: Measurement) -> float:
    return measurement.num_gaussians / (measurement.num_context * measurement.height * measurement.width)


def _pruning(found: Sequence[Measurement]) -> str:
    """Return a table with means over entries and the largest loss of an entry."""
    whole = {(m.entry, m.setting): m for m in found if m.system == OURS and not m.error}
    pairs = [
        (whole[m.entry, m.setting], m)
        for m in found
        if m.system == PRUNED and (m.entry, m.setting) in whole and not m.error
    ]
    head = (
        "fewer Gaussians, %",
        "loss of target views, dB",
        "largest loss of an entry",
        "loss of context views",
        f"at least {LEAST_FEWER_GAUSSIANS:.0f}% at under {LARGEST_LOSS_DB} dB",
    )
    if not pairs:
        return table(head, [])
    saved = fmean(100 * (1 - kept.num_gaussians / every.num_gaussians) for every, kept in pairs)
    losses = [every.psnr - kept.psnr for every, kept in pairs]
    context = fmean(every.context_psnr - kept.context_psnr for every, kept in pairs)
    is_met = saved >= LEAST_FEWER_GAUSSIANS and fmean(losses) < LARGEST_LOSS_DB
    numbers = (number(saved, 1), number(fmean(losses), 3), number(max(losses), 3), number(context, 3))
    return table(head, [(*numbers, "met" if is_met else "missed")])
