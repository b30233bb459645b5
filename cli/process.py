"""The process: settings that are applied before libraries are imported, and clean ends on Ctrl-C, SIGTERM or SIGHUP.

The settings do not change results. A signal raises an exception, which unwinds the command and removes its unfinished
files.
"""

import ctypes
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from types import FrameType

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # of glibc's <malloc.h>
_LARGEST_TRIM_THRESHOLD = 2**28  # bytes of free memory that the process keeps
# Bytes of the smallest block that has memory of its own, the most that glibc takes. Pixels of large photographs are
# larger: among freed blocks, they would leave gaps that the next ones do not fit, of gigabytes in all.
_MMAP_THRESHOLD = 2**25
SECONDS_TO_END = 2.0
_SECONDS_IN_IMPORT = 0.05  # until the end of an import is looked for again
_IMPORT = "<frozen importlib._bootstrap>"  # file name of the frames of an import
_DESCRIPTIONS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}


def prepare_process() -> None:
    """Tune OpenMP and malloc, hide Python and NumPy warnings, which are meant for developers, and forbid telemetry.

    OpenMP threads of torch spin for milliseconds while they wait and occupy cores that the rasteriser needs; a lower
    spin count lets them sleep earlier. malloc gives each large block and each thread memory of its own, which the
    system clears at every allocation; without that, all threads use freed memory again as it is. Settings in the
    environment take precedence, PYTHONWARNINGS included. onnxruntime would report to its vendor from its import on.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    if sys.platform != "linux" or any(name.startswith("MALLOC_") for name in os.environ):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc
        mallopt(_M_MMAP_THRESHOLD, _MMAP_THRESHOLD)
        mallopt(_M_ARENA_MAX, 1)
        mallopt(_M_TRIM_THRESHOLD, _LARGEST_TRIM_THRESHOLD)


def prepare_streams() -> None:
    """Replace standard streams that are not there, and letters that the encoding of stdout lacks.

    A program without a console, and one with closed streams, has None in their places. The first files that are opened
    would take closed descriptors, and get what libraries print.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - open until the process ends
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


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


@contextmanager
def ending_later() -> Iterator[Callable[[], bool]]:
    """Let a block end in its own way at a signal, which takes effect after the block; a second one does so at once.

    Yields a function that returns whether a signal was received. Signals that are ignored stay ignored.
    """
    handlers = {number: signal.getsignal(number) for number in _ending_signals()}
    heeded = {number: handler for number, handler in handlers.items() if handler not in (signal.SIG_IGN, None)}
    received: list[int] = []

    def restore() -> None:
        for number, handler in heeded.items():
            signal.signal(number, handler)

    def record(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        restore()

    for number in heeded:
        signal.signal(number, record)
    try:
        yield lambda: bool(received)
    finally:
        restore()
    if received:
        signal.raise_signal(received[0])


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
