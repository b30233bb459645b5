"""Sections of the report: Markdown text with tables and charts, which matplotlib draws as PNG files."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fecocodec.atomic import write_atomically
from fecocodec.evaluation.extras import require_extra

SIZE_INCHES, PANEL_INCHES, DPI = (7.6, 4.6), (4.0, 3.8), 100  # of a chart, of one of several charts
MARKERS = "osD^vP*Xhp<>d8"


@dataclass(frozen=True)
class Mark:
    """One point of a chart. note: text of its tooltip."""

    x: float
    y: float
    note: str


@dataclass(frozen=True)
class Series:
    """Marks with one name and colour. is_line: whether they are connected by a line, in the given order."""

    name: str
    marks: tuple[Mark, ...]
    is_line: bool = True


@dataclass(frozen=True)
class Chart:
    """A scatter or line chart. name: file name without extension. front: Pareto front, drawn as a step line."""

    name: str
    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    has_log_x: bool = False
    has_log_y: bool = False
    front: tuple[Mark, ...] = ()


def pareto_front(marks: Iterable[Mark]) -> tuple[Mark, ...]:
    """Return the Pareto-optimal marks (small x, large y), ordered by x."""
    front: list[Mark] = []
    for mark in sorted(marks, key=lambda mark: (mark.x, -mark.y)):
        if not front or mark.y > front[-1].y:
            front.append(mark)
    return tuple(front)


def write_png(chart: Chart, path: Path) -> None:
    """Write or replace the file. Raises InputError if matplotlib is not installed, OutputError if writing fails."""
    figure = _figure(SIZE_INCHES)
    axes = figure.subplots()
    _draw(chart, axes)
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    _save(figure, path)


def write_panels(charts: Sequence[Chart], path: Path) -> None:
    """Draw charts beside each other, with one scale of y. Writes and raises as `write_png` does."""
    figure = _figure((PANEL_INCHES[0] * len(charts), PANEL_INCHES[1]))
    for chart, axes in zip(charts, figure.subplots(1, len(charts), sharey=True, squeeze=False)[0], strict=True):
        _draw(chart, axes)
        axes.legend(fontsize=8)
        axes.label_outer()
    _save(figure, path)


def _figure(size: tuple[float, float]) -> Any:
    return require_extra("matplotlib.figure", "drawing charts").Figure(size, DPI, layout="constrained")


def _save(figure: Any, path: Path) -> None:
    with write_atomically(path, overwrite=True) as temporary:
        figure.savefig(temporary, format="png")


def _draw(chart: Chart, axes: Any) -> None:
    colours = require_extra("matplotlib", "drawing charts").colormaps["tab20"].colors
    for number, series in enumerate(chart.series):
        axes.plot(
            [mark.x for mark in series.marks],
            [mark.y for mark in series.marks],
            label=series.name,
            color=colours[(2 * number + number // 10) % len(colours)],
            marker=MARKERS[number % len(MARKERS)],
            markersize=5,
            linewidth=1.4 if series.is_line else 0.0,
        )
    if chart.front:
        xs, ys = [mark.x for mark in chart.front], [mark.y for mark in chart.front]
        axes.step(xs, ys, where="post", color="0.4", linewidth=1.0, linestyle="--", label="Pareto front")
    axes.set(title=chart.title, xlabel=chart.x_label, ylabel=chart.y_label)
    for axis, is_log, name in ((axes.xaxis, chart.has_log_x, "x"), (axes.yaxis, chart.has_log_y, "y")):
        if is_log:
            axes.set(**{f"{name}scale": "log"})
            ticker = require_extra("matplotlib.ticker", "drawing charts")
            axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(ticker.NullFormatter())
    axes.grid(visible=True, linewidth=0.3)


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

    Numbers of two-view entries: entries, for rate, quality and speed; complexity_entries, for file size against
    complexity (None: all); stress_scenes, to derive stress cases from (0: no stress cases).
    entries_of_more_views: number of entries with more than two context views.

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
