"""Draw a chart as a PNG file with matplotlib."""

from pathlib import Path
from typing import Any

from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.report.charts import Chart
from fecocodec.formats.atomic import write_atomically

SIZE_INCHES, DPI = (7.6, 4.6), 100
MARKERS = "osD^vP*Xhp<>d8"


def write_png(chart: Chart, path: Path) -> None:
    """Write or replace the file. Raises InputError if matplotlib is not installed, OutputError if writing fails."""
    figure = require_extra("matplotlib.figure", "drawing charts").Figure(SIZE_INCHES, DPI, layout="constrained")
    axes = figure.subplots()
    _draw(chart, axes)
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
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.01, 1.0))
