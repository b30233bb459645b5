"""A section of the report: its title, its Markdown text, and the charts in it."""

from collections.abc import Sequence
from dataclasses import dataclass

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
