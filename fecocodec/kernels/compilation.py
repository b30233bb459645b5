"""How this folder compiles its numba kernels."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numba

# The kernels release the global interpreter lock, so that `threads.run_in_ranges` can run them side by side. Sums may
# be reordered and fused, which lets loops use vector registers; NaN and infinity keep their meaning, because projection
# relies on them to drop broken Gaussians.
_njit = partial(numba.njit, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile for the processor on first use, and keep the result on disk where there is a place for it.

    numba renews its cache when the file of a kernel changes, not when a helper imported from another file does:
    after editing such a helper, delete this folder's `__pycache__`.
    """
    try:
        return _njit(cache=True)(function)
    except RuntimeError:  # numba found no folder it may write its cache to
        return _njit(cache=False)(function)
