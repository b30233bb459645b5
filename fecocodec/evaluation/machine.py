"""Where and when something was measured: without it a number of seconds says nothing."""

import platform
from contextlib import suppress
from datetime import date
from pathlib import Path

import torch

import fecocodec


def describe_machine() -> dict[str, str]:
    """Processor, threads, versions and date, as text."""
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
