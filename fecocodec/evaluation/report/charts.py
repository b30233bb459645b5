"""Data of charts: `png` draws them as images, `page` as an interactive page with tooltips."""

from collections.abc import Iterable
from dataclasses import dataclass


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
