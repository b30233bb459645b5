"""Peak memory: resident memory of this process (Linux), or memory allocated on a CUDA device."""

import ctypes
import gc
from contextlib import suppress
from pathlib import Path

import torch

_PROCESS = Path("/proc/self")


def return_freed_memory() -> None:
    """Return freed heap memory to the operating system, so that it does not count in the next peak (glibc only)."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def forget_peak(device: str = "cpu") -> None:
    """Reset the peak to the current memory. No effect on systems without this counter. device: "cpu" or "cuda:N"."""
    if device != "cpu":
        torch.cuda.reset_peak_memory_stats(device)
        return
    with suppress(OSError):
        (_PROCESS / "clear_refs").write_text("5")


def peak_mib(device: str = "cpu") -> float | None:
    """Return the peak memory in MiB since `forget_peak`, or None if the system does not report it."""
    if device != "cpu":
        return torch.cuda.max_memory_allocated(device) / 2**20
    with suppress(OSError):
        for line in (_PROCESS / "status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return None
