"""Charts of the report, and their drawing as PNG files with matplotlib."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fecocodec.atomic import write_atomically
from fecocodec.evaluation.extras import require_extra


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


SIZE_INCHES, PANEL_INCHES, DPI = (7.6, 4.6), (4.0, 3.8), 100  # of a chart, of one of several charts
MARKERS = "osD^vP*Xhp<>d8"


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
