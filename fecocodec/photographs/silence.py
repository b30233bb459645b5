"""Discard what foreign libraries print, so that a damaged file is one sentence and data on stdout stay data."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from threading import Lock

_STDERR = 2
_LOCK = Lock()  # descriptors belong to the whole process


@contextmanager
def silenced() -> Iterator[None]:
    """Discard what the block prints on Python's stdout, and what C++ code in it prints on stderr."""
    with _LOCK, redirect_stdout(StringIO()), open(os.devnull, "wb") as nowhere:
        try:
            kept = os.dup(_STDERR)
        except OSError:  # closed
            yield
            return
        os.dup2(nowhere.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(kept, _STDERR)
            os.close(kept)
