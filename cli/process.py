"""What a command asks of its own process before libraries load; results do not depend on it."""

import ctypes
import os
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's <malloc.h>
_LARGEST_MMAP_THRESHOLD = 32 * 2**20  # what glibc accepts
_NEVER = 2**31 - 1


def prepare_process() -> None:
    """Save a tenth of an encoding's time.

    Torch's threads wait for their next work by spinning, for milliseconds, on processors that the rasteriser's threads
    need: let them sleep sooner. And memory of a picture's size goes back to the system when it is freed, only to be
    asked for, and cleared, again: keep it. What the environment says already is left as it is.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")
    if sys.platform != "linux" or any(name.startswith("MALLOC_") for name in os.environ):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD)
        mallopt(_M_TRIM_THRESHOLD, _NEVER)
