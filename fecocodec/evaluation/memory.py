"""Peak resident memory of this process (Linux)."""

import ctypes
import gc
from contextlib import suppress
from pathlib import Path

_PROCESS = Path("/proc/self")


def give_back_freed_memory() -> None:
    """Return freed heap memory to the operating system, so that it counts in no peak; glibc only."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def forget_peak() -> None:
    """Reset the peak to the memory held now; no effect where the system has no such counter."""
    with suppress(OSError):
        (_PROCESS / "clear_refs").write_text("5")


def peak_mib() -> float | None:
    """Peak resident memory in MiB since `forget_peak`, None where the system does not report it."""
    with suppress(OSError):
        for line in (_PROCESS / "status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return None
