"""Progress of long work on stderr: a progress bar on a terminal, occasional lines in a pipe or log file."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from .output import say
from .verbosity import Verbosity, verbosity

OnProgress = Callable[[str, float], None]

SECONDS_BETWEEN_LINES = 30.0


@contextmanager
def progress_bar() -> Iterator[OnProgress]:
    """Yield a callback that takes the name of the current step and the completed fraction of all work, in [0, 1]."""
    if verbosity() is Verbosity.QUIET:
        yield lambda _step, _fraction: None
        return
    if verbosity() is Verbosity.VERBOSE:
        yield _each_step()
        return
    if not sys.stderr.isatty():
        yield _lines()
        return

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda step, fraction: bar.update(task, description=step, completed=fraction)


def _lines() -> OnProgress:
    """Return a callback that prints at most one line every SECONDS_BETWEEN_LINES, and none for shorter work."""
    last = monotonic()

    def report(step: str, fraction: float) -> None:
        nonlocal last
        if monotonic() - last >= SECONDS_BETWEEN_LINES:
            last = monotonic()
            say(f"{step}: {100 * fraction:.0f}% done")

    return report


def _each_step() -> OnProgress:
    """Return a callback that prints each step when it starts, with the seconds since the work started."""
    start, last = monotonic(), ""

    def report(step: str, fraction: float) -> None:
        nonlocal last
        if step != last:
            last = step
            say(f"{monotonic() - start:8.2f} s  {100 * fraction:3.0f}%  {step}")

    return report
