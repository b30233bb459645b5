"""Memory of large photographs returns to the system, so that a folder of hundreds does not fill it."""

import subprocess
import sys

import pytest

SCRIPT = """
from fecosplat_cli.process import prepare_process
prepare_process()
import numpy as np
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096
before = resident()
pixels = np.ones((3000, 4000, 3), np.uint8)
kept = np.ones(2**20, np.uint8)  # behind the pixels, if they are of one heap
most = resident()
del pixels
print(most - before, resident() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="malloc of glibc")
def test_pixels_of_a_large_photograph_are_given_back() -> None:
    found = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=60)
    most, after = map(int, found.stdout.split())
    assert most > 36_000_000 and after < 5_000_000
