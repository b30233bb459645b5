"""Independent work on as many threads as torch uses: whole tasks in parallel, or one kernel over a range of items."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, TypeVar

import torch

Result = TypeVar("Result")

_RANGES_PER_THREAD = 8  # several, because some ranges hold far more work than others
_worker = threading.local()


def run_side_by_side(task: Callable[[int], Result], count: int) -> list[Result]:
    """Return [task(0), ..., task(count - 1)], computed in parallel with one thread each.

    Fewer tasks than threads run one after another, each with all threads. Whole tasks in parallel are faster, because
    each task has parts that run on one thread.
    """
    num_threads = _num_threads()
    if num_threads == 1 or count < num_threads:
        return [task(index) for index in range(count)]
    with ThreadPoolExecutor(num_threads, initializer=setattr, initargs=(_worker, "is_one", True)) as pool:
        return list(pool.map(task, range(count)))


def _num_threads() -> int:
    """Number of threads available to the caller: 1 inside a worker of `run_side_by_side`."""
    return 1 if getattr(_worker, "is_one", False) else torch.get_num_threads()


def run_in_ranges(kernel: Callable[..., Any], count: int, *arguments: Any) -> None:
    """Call `kernel(start, stop, *arguments)` in parallel on ranges that partition [0, count).

    The result of an item must not depend on its range; then the number of threads changes no bit.
    """
    num_threads = _num_threads()
    if num_threads == 1:
        kernel(0, count, *arguments)
        return
    num_ranges = num_threads * _RANGES_PER_THREAD
    bounds = [count * index // num_ranges for index in range(num_ranges + 1)]
    with ThreadPoolExecutor(num_threads) as pool:
        for finished in [pool.submit(kernel, start, stop, *arguments) for start, stop in pairwise(bounds)]:
            finished.result()
