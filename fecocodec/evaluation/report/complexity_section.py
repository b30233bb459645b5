"""Report section: file size and number of Gaussians against scene complexity."""

from collections.abc import Mapping, Sequence

from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.section import Section, picture
from fecocodec.evaluation.stress.complexity import LAMBDA, Need
from fecocodec.evaluation.summary import OURS

TEXT = """\
Complexity is the size of the context views as JPEG XL at distance 1. Files at lambda 1e-3, of photographs and of
synthetic rooms whose walls have no pattern or the sum of up to {waves} patterns.

{bytes_chart}

{gaussians_chart}
"""


def complexity_section(
    photographs: Sequence[Measurement],
    complexity: Mapping[str, float],
    needs: Sequence[Need],
) -> Section:
    """Return the section.

    photographs: measurements of pairs at one lambda. complexity: size of the context views in KiB, by entry of
    `photographs`. needs: measurements of synthetic rooms.
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
    )
    return Section("Bytes, Gaussians and complexity", text, (kib, gaussians))


def _note(need: Need) -> str:
    return f"{need.num_waves} patterns"


def _density(measurement: Measurement) -> float:
    return measurement.num_gaussians / (measurement.num_context * measurement.height * measurement.width)
