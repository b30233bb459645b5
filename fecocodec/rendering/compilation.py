"""How this folder compiles its numba kernels."""

from collections.abc import Callable
from typing import Any

import numba

# Sums may be reordered and fused, which lets loops use vector registers; NaN and infinity keep their meaning,
# because projection relies on them to drop broken Gaussians.
_FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile for the processor on first use and keep the result on disk where the disk allows it.

    The kernels release the global interpreter lock, so that `threads.run_in_ranges` can run them side by side.
    numba renews its cache when the file of a kernel changes, not when a helper imported from another file does:
    after editing such a helper, delete this folder's `__pycache__`.
    """
    options = {"nogil": True, "fastmath": _FAST_MATH, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder it may write its cache to
        return numba.njit(**options)(function)
