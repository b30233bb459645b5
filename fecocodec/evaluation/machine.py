"""Description of the machine and software of a measurement, without which timings have no meaning."""

import platform
from contextlib import suppress
from datetime import date
from pathlib import Path

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
