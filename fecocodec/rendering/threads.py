"""Run one kernel over a range of independent items on as many threads as torch uses."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import torch

_RANGES_PER_THREAD = 8  # more than one, because some tiles hold far more work than others


def run_in_ranges(kernel: Callable[..., Any], count: int, *arguments: Any) -> None:
    """Call `kernel(start, stop, *arguments)` so that the ranges cover 0 to `count` once.

    An item's result must not depend on the range it falls into; then the thread count changes no bit.
    """
    num_threads = torch.get_num_threads()
    if num_threads == 1:
        kernel(0, count, *arguments)
        return
    num_ranges = num_threads * _RANGES_PER_THREAD
    bounds = [count * index // num_ranges for index in range(num_ranges + 1)]
    with ThreadPoolExecutor(num_threads) as pool:
        for finished in [pool.submit(kernel, start, stop, *arguments) for start, stop in pairwise(bounds)]:
            finished.result()
