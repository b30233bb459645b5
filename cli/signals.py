"""Terminate a command cleanly on Ctrl-C, SIGTERM or SIGHUP: an exception unwinds it and removes unfinished files."""

import signal
from types import FrameType

SECONDS_TO_END = 2.0
_SECONDS_IN_IMPORT = 0.05  # until the end of an import is looked for again
_IMPORT = "<frozen importlib._bootstrap>"  # file name of the frames of an import
_DESCRIPTIONS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}


class EndingSignals:
    """Context manager in which these signals raise SystemExit and are recorded. Signals that were ignored stay ignored.

    Check `received` to detect a signal: a library that is interrupted during its import can raise another error
    instead. If a library catches SystemExit and continues, it is raised again every SECONDS_TO_END. During an import it
    waits for the end of the import: an exception that passes through the C++ code of a library, torch among them,
    aborts the process.
    """

    def __init__(self) -> None:
        self.received: int | None = None

    @property
    def description(self) -> str:
        """Text for the message on stderr; empty if no signal was received."""
        return "" if self.received is None else _DESCRIPTIONS[signal.Signals(self.received).name]

    def __enter__(self) -> "EndingSignals":
        for number in _ending_signals():
            if signal.getsignal(number) is not signal.SIG_IGN:  # set by `nohup` and by shells
                signal.signal(number, self._end)
        return self

    def __exit__(self, *_: object) -> None:
        if self.received is not None:
            _repeat_after(0.0)
        for number in _ending_signals():
            if signal.getsignal(number) == self._end:
                signal.signal(number, signal.SIG_DFL)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.received = number
        if hasattr(signal, "SIGALRM"):
            signal.signal(signal.SIGALRM, self._end_again)
            if _is_importing(frame):
                _repeat_after(_SECONDS_IN_IMPORT)
                return
            _repeat_after(SECONDS_TO_END)
        raise SystemExit(128 + number)

    def _end_again(self, number: int, frame: FrameType | None) -> None:
        if _is_importing(frame):
            return
        _repeat_after(SECONDS_TO_END)
        raise SystemExit


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether a module is being imported in this frame or around it."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False


def _repeat_after(seconds: float) -> None:
    """Start the interval timer that sends SIGALRM; 0 stops it."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)


def _ending_signals() -> list[int]:
    return [getattr(signal, name) for name in _DESCRIPTIONS if hasattr(signal, name)]  # no SIGHUP on Windows
