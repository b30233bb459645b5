"""Charts as data: drawn as PNG by `png`, and as a page that one can hover by `page`."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Mark:
    """One point. note: shown beside the pointer."""

    x: float
    y: float
    note: str


@dataclass(frozen=True)
class Series:
    """Marks of one name and colour. is_line: whether they are joined, in the order given."""

    name: str
    marks: tuple[Mark, ...]
    is_line: bool = True


@dataclass(frozen=True)
class Chart:
    """name: of its file. front: the marks that no other beats, drawn as a stepped line; empty without one."""

    name: str
    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    has_log_x: bool = False
    has_log_y: bool = False
    front: tuple[Mark, ...] = ()


def pareto_front(marks: Iterable[Mark]) -> tuple[Mark, ...]:
    """The marks for which no other has both less x and more y, by rising x."""
    front: list[Mark] = []
    for mark in sorted(marks, key=lambda mark: (mark.x, -mark.y)):
        if not front or mark.y > front[-1].y:
            front.append(mark)
    return tuple(front)
