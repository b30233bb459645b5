"""The most memory this process has held, where the system tells (Linux)."""

import ctypes
import gc
from contextlib import suppress
from pathlib import Path

_PROCESS = Path("/proc/self")


def give_back_freed_memory() -> None:
    """Let the system have what was freed and kept for later, so that it counts in no peak; only with glibc."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def forget_peak() -> None:
    """Let the peak begin anew at what is held now; does nothing where the system cannot."""
    with suppress(OSError):
        (_PROCESS / "clear_refs").write_text("5")


def peak_mib() -> float | None:
    """Peak resident memory in MiB since `forget_peak`, None where the system does not tell."""
    with suppress(OSError):
        for line in (_PROCESS / "status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return None
