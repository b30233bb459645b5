"""Compilation of numba kernels, with the same options everywhere and a cache on disk where that is possible."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pickle import UnpicklingError
from typing import Any

import numba
from numba.core.caching import FunctionCache

from fecocodec.progress import ON_COMPILATION

# Kernels release the global interpreter lock, so that `threads.run_in_ranges` can run them in parallel. Sums may be
# reordered and fused, so that loops vectorise. NaN and infinity keep their meaning: projection relies on them to drop
# Gaussians that are not finite.
_njit = partial(numba.njit, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: compile a function for this processor on first call, and cache the result on disk if possible.

    numba invalidates its cache when the file of a kernel changes, but not when a helper from another file does. After
    editing such a helper, delete the `__pycache__` folders of the kernels that call it.
    """
    dispatcher: Callable[..., Any] = _njit(cache=False)(function)
    with suppress(RuntimeError):  # numba has no folder to which it can write its cache
        dispatcher._cache = _OptionalCache(function)  # type: ignore[attr-defined]  # as `cache=True` does
    return dispatcher


class _OptionalCache(FunctionCache):
    """numba's cache on disk. Kernels that cannot be read from it are compiled; those it cannot hold are not cached."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = None
        with suppress(OSError, EOFError, UnpicklingError):
            found = super().load_overload(sig, target_context)
        for tell in ON_COMPILATION if found is None else ():
            tell()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # such as a full disk
            super().save_overload(sig, data)
