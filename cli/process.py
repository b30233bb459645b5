"""Process-wide settings, applied before libraries are imported. They do not change results."""

import ctypes
import os
import sys
import warnings

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's <malloc.h>
_LARGEST_MMAP_THRESHOLD = 32 * 2**20  # maximum that glibc accepts
_NEVER = 2**31 - 1


def prepare_process() -> None:
    """Tune OpenMP and malloc, and hide Python and NumPy warnings, which are meant for developers.

    OpenMP threads of torch spin for milliseconds while they wait and occupy cores that the rasteriser needs; a lower
    spin count lets them sleep earlier. malloc returns large freed blocks to the operating system, which clears them
    when they are allocated again; higher thresholds keep them in the process. Settings in the environment take
    precedence, PYTHONWARNINGS included.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")
    if sys.platform != "linux" or any(name.startswith("MALLOC_") for name in os.environ):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD)
        mallopt(_M_TRIM_THRESHOLD, _NEVER)
