"""Choice of views that depends on the photographs of a scene: `spread:4`, `auto` or `all`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Spread:
    """`count` views, as far apart as possible while they overlap."""

    count: int


@dataclass(frozen=True)
class Auto:
    """At most eight overlapping views that cover the middle of the capture."""


@dataclass(frozen=True)
class All:
    """All views, even those that harm the others."""


Selection = tuple[int | str, ...] | Spread | Auto | All


def may_leave_out(selection: Selection | None) -> bool:
    """Return whether views that harm the others may be left out: the user named none, and did not ask for all."""
    return selection is None or isinstance(selection, Spread | Auto)
