"""A section of the report: its title, its Markdown text, and the charts in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fecocodec.evaluation.report.charts import Chart


@dataclass(frozen=True)
class Section:
    """text: Markdown that includes each chart as `![...](report/NAME.png)`, see `picture`."""

    title: str
    text: str
    charts: tuple[Chart, ...] = ()


def picture(chart: Chart) -> str:
    """Return the Markdown that includes the PNG file of a chart."""
    return f"![{chart.title}](report/{chart.name}.png)"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)


def number(value: float | None, digits: int = 2) -> str:
    """Format a number with `digits` decimals and without negative zero; None is a dash."""
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


@dataclass(frozen=True)
class ReportPlan:
    """Specification of a report.

    root, index: scenes and evaluation index. model: folder of the weights. work: folder of measurements, reused by the
    next run. output: folder that receives `report.md` and `report/`.

    Numbers of two-view entries: entries, for rate and quality; speed_entries, of those, for timings;
    complexity_entries, for file size against complexity (None: all); stress_scenes, to derive stress cases from (0: no
    stress cases). entries_of_more_views: number of entries with more than two context views.

    lambdas: of the main curve. few_lambdas: of the other curves. sides, view_counts: image sides in pixels and numbers
    of views of the scaling study. room_side, num_waves: image side and numbers of patterns of the synthetic rooms.
    size: (height, width) of photographs, None for `protocol_size`.
    """

    root: Path
    index: Path
    model: Path
    work: Path
    output: Path
    entries: int = 12
    speed_entries: int = 3
    complexity_entries: int | None = None
    entries_of_more_views: int = 4
    stress_scenes: int = 3
    lambdas: tuple[float, ...] = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5)
    few_lambdas: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    sides: tuple[int, ...] = (64, 128, 256, 512, 1024)
    view_counts: tuple[int, ...] = (1, 2, 4, 8, 16)
    room_side: int = 256
    num_waves: tuple[int, ...] = (0, 1, 2, 4, 8, 16, 24)
    size: tuple[int, int] | None = None


def quick(plan: ReportPlan) -> ReportPlan:
    """Return a plan with a few small images, to test the generation of the report. The numbers have no meaning."""
    return replace(
        plan,
        entries=1,
        speed_entries=1,
        complexity_entries=1,
        entries_of_more_views=1,
        stress_scenes=0,
        lambdas=(1e-2, 1e-3),
        few_lambdas=(1e-2, 1e-3),
        sides=(64, 128),
        view_counts=(1, 2),
        room_side=64,
        num_waves=(0, 24),
        size=(96, 96),
    )
