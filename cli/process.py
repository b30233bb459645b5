"""Process-wide settings, applied before libraries are imported. They do not change results."""

import ctypes
import os
import sys
import warnings

_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8  # of glibc's <malloc.h>
_LARGEST_TRIM_THRESHOLD = 2**28  # bytes of free memory that the process keeps


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
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_ARENA_MAX, 1)
        mallopt(_M_TRIM_THRESHOLD, _LARGEST_TRIM_THRESHOLD)
