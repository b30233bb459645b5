"""Progress is for a person at a terminal: on stderr, and silent where nobody watches."""

import io
import sys

import pytest
from fecosplat_cli.progress import progress_bar

from fecocodec.progress import ON_COMPILATION


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_log_of_short_work_stays_empty(capsys: pytest.CaptureFixture[str], clock) -> None:
    optimise(clock, 0.1, 36)
    assert capsys.readouterr() == ("", "")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Set the time of the progress by writing to the only element of this list."""
    now = [0.0]
    monkeypatch.setattr("fecosplat_cli.progress.monotonic", lambda: now[0])
    return now


def optimise(clock: list[float], seconds_per_step: float, num_steps: int) -> None:
    """Report a slow start, then steps of equal length that make up nine tenths of the bar."""
    with progress_bar() as on_progress:
        on_progress("matching views", 0.0)
        clock[0] += 15
        for number in range(num_steps):
            on_progress("optimising", 0.1 + 0.9 * number / num_steps)
            clock[0] += seconds_per_step


def test_long_work_prints_the_time_left_after_its_first_step(clock, capsys: pytest.CaptureFixture[str]) -> None:
    optimise(clock, 2.0, 36)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "optimising: 12% done, about 70 s left"
    assert lines[1:] == ["optimising: 38% done, about 50 s left", "optimising: 62% done, about 30 s left",
                         "optimising: 88% done, about 10 s left"]  # fmt: skip


def test_a_terminal_shows_the_step_and_the_time_left(clock, monkeypatch, capsys) -> None:
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(sys, "stderr", terminal)
    optimise(clock, 2.0, 36)
    shown = terminal.getvalue()
    assert "optimising" in shown and "about" in shown and "s left" in shown
    assert capsys.readouterr().out == ""


def test_a_step_at_the_start_is_not_zero_percent_done(clock, capsys: pytest.CaptureFixture[str]) -> None:
    """The first line of a log, where loading took longer than the interval between lines."""
    with progress_bar() as on_progress:
        clock[0] += 25
        on_progress("matching views", 0.0)
    assert capsys.readouterr().err == "matching views: started\n"


def test_the_time_left_follows_the_pace_of_all_steps(clock, capsys: pytest.CaptureFixture[str]) -> None:
    """One step that passes fast says little about those that follow."""
    with progress_bar() as on_progress:
        for step, fraction, seconds in (("matching", 0.1, 30), ("fading", 0.4, 1), ("fading", 0.5, 1)):
            on_progress(step, fraction)
            clock[0] += seconds
        on_progress("optimising", 0.5)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "fading: 40% done, about 60 s left"


def test_the_time_left_starts_again_after_kernels_were_compiled(clock, capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as on_progress:
        on_progress("matching", 0.1)
        for tell in ON_COMPILATION * 2:
            clock[0] += 30
            tell()
        for fraction in (0.2, 0.3):
            on_progress("optimising", fraction)
            clock[0] += 25
    assert ON_COMPILATION == []
    assert capsys.readouterr().err.splitlines() == [
        "note: kernels are compiled for this machine; this happens once.",
        "optimising: 20% done",
        "optimising: 30% done, about 3 min left",
    ]
