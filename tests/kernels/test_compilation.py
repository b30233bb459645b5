"""Kernels work where numba's cache on disk does not."""

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from numba.core import config
from numba.core.caching import FunctionCache

from fecocodec.kernels.compilation import compiled


@pytest.mark.parametrize("method", ["_save_overload", "_load_overload"])
def test_a_full_disk_under_the_cache(method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))  # empty, so that results of earlier runs are not found
    calls = []

    def refuse(*_arguments: Any) -> None:
        calls.append(method)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def doubled(value: float) -> float:
        return 2 * value

    monkeypatch.setattr(FunctionCache, method, refuse)
    assert compiled(doubled)(1.5) == 3.0
    assert calls, "the cache was not asked"
