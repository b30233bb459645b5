"""Choice of views that depends on the photographs of a scene: so many, as many as it needs, or all."""

from dataclasses import dataclass

LONGEST_NUMBER = 9  # digits of a number that the user gives


@dataclass(frozen=True)
class Spread:
    """`count` views, as far apart as possible while they overlap."""

    count: int


@dataclass(frozen=True)
class Auto:
    """As many views as the scene needs; of `read_views`, at most eight overlapping ones of the middle of a capture."""


@dataclass(frozen=True)
class All:
    """All views."""


Selection = tuple[int | str, ...] | Spread | Auto | All
Guides = tuple[int | str, ...] | Spread | None
"""Which photographs guide: those that are named, at most so many, or None for as many as are of use."""
