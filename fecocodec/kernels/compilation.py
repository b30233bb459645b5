"""Compilation of numba kernels, with the same options everywhere."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numba

# Kernels release the global interpreter lock, so that `threads.run_in_ranges` can run them in parallel. Sums may be
# reordered and fused, so that loops vectorise. NaN and infinity keep their meaning: projection relies on them to drop
# Gaussians that are not finite.
_njit = partial(numba.njit, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: compile a function for this processor on first call, and cache the result on disk if possible.

    numba invalidates its cache when the file of a kernel changes, but not when a helper from another file does. After
    editing such a helper, delete the `__pycache__` folders of the kernels that call it.
    """
    try:
        return _njit(cache=True)(function)
    except RuntimeError:  # numba has no folder to which it can write its cache
        return _njit(cache=False)(function)
