"""Draw charts as PNG files with matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fecocodec.atomic import write_atomically
from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.report.charts import Chart

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
