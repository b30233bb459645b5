"""Progress is for a person at a terminal: on stderr, and silent where nobody watches."""

import io
import sys

import pytest
from fecosplat_cli.progress import progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def work() -> None:
    with progress_bar() as on_progress:
        on_progress("matching views", 0.1)
        on_progress("coding stage 1", 0.5)


def test_a_terminal_shows_the_step(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    work()
    assert "coding stage 1" in terminal.getvalue()
    assert capsys.readouterr().out == ""


def test_a_log_file_stays_empty(capsys: pytest.CaptureFixture[str]) -> None:
    work()
    assert capsys.readouterr() == ("", "")
