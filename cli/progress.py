"""Progress of long work on stderr: a progress bar on a terminal, occasional lines in a pipe or log file."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from fecocodec.progress import ON_COMPILATION, OnProgress

from .output import Verbosity, say, verbosity

SECONDS_BETWEEN_LINES = 20.0  # of a log; longer work also gets a line as soon as its time is known


@contextmanager
def progress_bar() -> Iterator[OnProgress]:
    """Yield a callback that takes the name of the current step and the completed fraction of all work, in [0, 1]."""
    if verbosity() is Verbosity.QUIET:
        yield lambda _step, _fraction: None
        return
    time_left = TimeLeft()
    is_told = False

    def on_compilation() -> None:
        nonlocal is_told
        time_left.restart()
        if not is_told:
            is_told = True
            say("note: kernels are compiled for this machine; this happens once.")

    ON_COMPILATION.append(on_compilation)
    try:
        with _shown(time_left) as on_progress:
            yield on_progress
    finally:
        ON_COMPILATION.remove(on_compilation)


@contextmanager
def _shown(time_left: "TimeLeft") -> Iterator[OnProgress]:
    is_verbose = verbosity() is Verbosity.VERBOSE
    if is_verbose or not sys.stderr.isatty():
        yield _lines(is_verbose, time_left)
        return

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)

        def show(step: str, fraction: float) -> None:
            left = time_left.after(fraction)
            bar.update(task, description=step if left is None else f"{step}, {in_words(left)}", completed=fraction)

        yield show


class TimeLeft:
    """Time left, estimated from the pace since the first fraction that was done, or since `restart`."""

    def __init__(self) -> None:
        self._start: tuple[float, float] | None = None

    def restart(self) -> None:
        """Leave out what has passed: it took time that does not come again."""
        self._start = None

    def after(self, fraction: float) -> float | None:
        """Return the seconds left once `fraction` of all work is done; None where no pace is known."""
        now = monotonic()
        if self._start is None and fraction > 0:
            self._start = now, fraction
        if self._start is None or fraction <= self._start[1]:
            return None
        return (now - self._start[0]) / (fraction - self._start[1]) * (1 - fraction) or None


def in_words(seconds_left: float) -> str:
    """Return a rounded time, such as `about 70 s left`."""
    if seconds_left < 90:
        return f"about {max(1, round(seconds_left, -1 if seconds_left > 15 else 0)):.0f} s left"
    return f"about {seconds_left / 60:.0f} min left"


def _lines(is_verbose: bool, time_left: TimeLeft) -> OnProgress:
    """Return a callback that prints a line every SECONDS_BETWEEN_LINES, none for shorter work.

    The first line is printed earlier, when the estimate of the time left exceeds SECONDS_BETWEEN_LINES. Verbose: there
    is a line when a step starts, with the seconds since the work started, and one with the time left of a long step.
    """
    start = last = monotonic()
    previous, is_first = "", True

    def report(step: str, fraction: float) -> None:
        nonlocal last, previous, is_first
        left = time_left.after(fraction)
        words = "" if left is None else in_words(left)
        is_long = is_first and left is not None and left >= SECONDS_BETWEEN_LINES
        if is_verbose and (step != previous or is_long):
            say(f"{monotonic() - start:8.2f} s  {100 * fraction:3.0f}%  {words if step == previous else step}")
            previous, is_first = step, step != previous
        elif not is_verbose and (is_long or monotonic() - last >= SECONDS_BETWEEN_LINES):
            last, is_first = monotonic(), False
            done = f"{100 * fraction:.0f}% done" if fraction else "started"
            say(f"{step}: {done}" + (words and f", {words}"))

    return report
