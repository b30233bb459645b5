"""Progress of a long call: which task runs, and the fraction that is done."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate, pairwise

OnProgress = Callable[[str, float], None]  # (current task, fraction done)
# Called whenever a kernel is compiled, at first use on a machine, which takes about a second.
ON_COMPILATION: list[Callable[[], None]] = []


def ignore_progress(_task: str, _fraction: float) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Progress:
    """Reports a part of the whole, which extends from the fraction `begin` to the fraction `end`."""

    report: OnProgress = ignore_progress
    begin: float = 0.0
    end: float = 1.0

    def __call__(self, task: str, fraction: float = 0.0) -> None:
        """Report a task and the fraction of this part that is done."""
        self.report(task, self.begin + (self.end - self.begin) * fraction)

    def split(self, *weights: float) -> tuple["Progress", ...]:
        """Return consecutive parts of this part, as long as their weights say."""
        ends = accumulate(weights, initial=0.0)
        bounds = [self.begin + (self.end - self.begin) * end / sum(weights) for end in ends]
        return tuple(Progress(self.report, *part) for part in pairwise(bounds))
