"""Peak resident memory of this process (Linux)."""

import ctypes
import gc
from contextlib import suppress
from pathlib import Path

_PROCESS = Path("/proc/self")


def give_back_freed_memory() -> None:
    """Return freed heap memory to the operating system, so that it does not count in the next peak (glibc only)."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def forget_peak() -> None:
    """Reset the peak to the current resident memory. No effect on systems without this counter."""
    with suppress(OSError):
        (_PROCESS / "clear_refs").write_text("5")


def peak_mib() -> float | None:
    """Return the peak resident memory in MiB since `forget_peak`, or None if the system does not report it."""
    with suppress(OSError):
        for line in (_PROCESS / "status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return None
