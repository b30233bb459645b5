"""The machine of a measurement: its description, peak memory, and the time of each step of a call."""

import ctypes
import gc
import platform
from contextlib import suppress
from datetime import date
from pathlib import Path
from time import perf_counter

import torch

import fecocodec


def describe_machine() -> dict[str, str]:
    """Return processor, number of threads, instruction set, versions and date, as text."""
    return {
        "processor": _processor(),
        "threads": str(torch.get_num_threads()),
        "vector instructions": torch.backends.cpu.get_cpu_capability(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "fecosplat": fecocodec.__version__,
        "date": date.today().isoformat(),
    }


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


_PROCESS = Path("/proc/self")


def forget_peak(device: str = "cpu") -> None:
    """Reset the peak to the memory in use now. No effect on systems without this counter. device: "cpu" or "cuda:N".

    Freed heap memory goes back to the operating system first (glibc only), or the next peak would contain it.
    """
    if device != "cpu":
        torch.cuda.reset_peak_memory_stats(device)
        return
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
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


class StepClock:
    """Progress callback that measures the seconds of each step. seconds: by name of the step, filled on the next call.

    A step lasts from its message to the next one.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._task, self._since = "start", perf_counter()

    def __call__(self, task: str, _fraction: float) -> None:
        self.close()
        self._task = task

    def close(self) -> None:
        """Record the end of the current step; call this after the measured call returns."""
        now = perf_counter()
        self.seconds[self._task] = self.seconds.get(self._task, 0.0) + now - self._since
        self._since = now
