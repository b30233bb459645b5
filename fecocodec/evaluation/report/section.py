"""A part of the report: a heading, Markdown under it, and the charts that it shows."""

from collections.abc import Sequence
from dataclasses import dataclass

from fecocodec.evaluation.report.charts import Chart


@dataclass(frozen=True)
class Section:
    """text: Markdown; a chart's place in it is `![...](report/NAME.png)`, see `picture`."""

    title: str
    text: str
    charts: tuple[Chart, ...] = ()


def picture(chart: Chart) -> str:
    """The Markdown that shows a chart's PNG beside the report."""
    return f"![{chart.title}](report/{chart.name}.png)"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)


def number(value: float | None, digits: int = 2) -> str:
    """With so many digits after the point and no negative zero, a dash for None."""
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"
