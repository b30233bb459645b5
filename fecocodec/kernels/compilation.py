"""How numba kernels are compiled, and cached on disk where that is possible."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pickle import UnpicklingError
from typing import Any

import numba
from numba.core.caching import FunctionCache

# The kernels release the global interpreter lock, so that `threads.run_in_ranges` can run them side by side. Sums may
# be reordered and fused, which lets loops use vector registers; NaN and infinity keep their meaning, because projection
# relies on them to drop broken Gaussians.
_njit = partial(numba.njit, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile for the processor on first use, and keep the result on disk where a folder is writable.

    numba renews its cache when the file of a kernel changes, not when a helper imported from another file does:
    after editing such a helper, delete this folder's `__pycache__`.
    """
    dispatcher: Callable[..., Any] = _njit(cache=False)(function)
    with suppress(RuntimeError):  # numba found no folder it may write its cache to
        dispatcher._cache = _OptionalCache(function)  # type: ignore[attr-defined]  # as `cache=True` does
    return dispatcher


class _OptionalCache(FunctionCache):
    """numba's cache on disk, without which kernels work too: where it cannot be read or written, they are compiled."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with suppress(OSError, EOFError, UnpicklingError):
            return super().load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # such as a full disk
            super().save_overload(sig, data)
