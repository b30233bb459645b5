"""Run graphs that treat every view alike on a few views at a time, so that their maps stay small and in the cache."""

from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np

from fecocodec.runtime.graphs import Graphs

CELLS_AT_ONCE = 2**15  # of the 1/4 grid, in all threads; 16 MiB for a map of 128 channels


def run_by_views(
    graphs: Graphs,
    name: str,
    grid: tuple[int, int, int],
    inputs_of: Callable[[slice], dict[str, Any]],
    *,
    axis: int = 0,
) -> list[np.ndarray]:
    """Run a graph on groups of views and return its outputs.

    grid: views, rows and columns of the 1/4 grid. inputs_of: returns the inputs of a group of views. axis: of the views
    in the outputs. Groups are run in parallel if every thread can have one, else one after another.
    """
    groups, is_parallel = groups_of_views(grid, graphs.num_threads)
    outputs = _Outputs(grid[0], axis)

    def run(graphs: Graphs, group: slice) -> None:
        outputs.insert(group, graphs.run(name, **inputs_of(group)))

    if is_parallel:
        graphs.map(run, groups)
    else:
        for group in groups:
            run(graphs, group)
    return outputs.arrays


class _Outputs:
    """Outputs of all views, into which each thread copies those of its group, so that these are freed soon."""

    def __init__(self, num_views: int, axis: int) -> None:
        self.arrays: list[np.ndarray] = []
        self._num_views, self._axis, self._making = num_views, axis, Lock()

    def insert(self, group: slice, parts: list[np.ndarray]) -> None:
        """Insert the outputs of a group. Their axis of views can have several entries for each view."""
        if group == slice(0, self._num_views):
            self.arrays = parts
            return
        num_views, before = group.stop - group.start, (slice(None),) * self._axis
        with self._making:
            if not self.arrays:
                self.arrays = [self._empty(part, part.shape[self._axis] // num_views) for part in parts]
        for whole, part in zip(self.arrays, parts, strict=True):
            per_view = part.shape[self._axis] // num_views
            whole[*before, group.start * per_view : group.stop * per_view] = part

    def _empty(self, part: np.ndarray, per_view: int) -> np.ndarray:
        shape = list(part.shape)
        shape[self._axis] = self._num_views * per_view
        return np.empty(shape, part.dtype)


def groups_of_views(grid: tuple[int, int, int], num_threads: int) -> tuple[list[slice], bool]:
    """Return groups of views, and whether every thread can have a group of its own within CELLS_AT_ONCE."""
    views, cells = grid[0], grid[1] * grid[2]
    is_parallel = cells * num_threads <= CELLS_AT_ONCE
    at_once = num_threads if is_parallel else 1
    size = min(max(1, CELLS_AT_ONCE // (at_once * cells)), -(-views // at_once))
    return [slice(first, min(first + size, views)) for first in range(0, views, size)], is_parallel


Arrays = dict[str, np.ndarray]


def run_over_others(graphs: Graphs, name: str, view: int, of_views: Arrays, start: Arrays) -> Arrays:
    """Run a graph once for every other view, and return its results after the last one.

    of_views: inputs, whose first axis is the view: NAME of the view itself, NAME_there of the other view. start:
    results before the first run, in the order of the graph's outputs; every run takes those of the run before.
    """
    num_views = len(next(iter(of_views.values())))
    names = graphs.input_names(name)
    own = {key: values[view, ...] for key, values in of_views.items()}  # `...` keeps single numbers arrays
    results = start
    for other in (*range(view + 1, num_views), *range(view)):
        inputs = own | {f"{key}_there": values[other, ...] for key, values in of_views.items()} | results
        results = dict(zip(start, graphs.run(name, **{key: inputs[key] for key in names}), strict=True))
    return results


def run_over_pairs(graphs: Graphs, name: str, of_views: Arrays, start: Arrays) -> list[np.ndarray]:
    """Run a graph once for every pair of views, and return its results. Their first axis is the view, as in `start`."""

    def results_of(graphs: Graphs, view: int) -> list[np.ndarray]:
        before = {key: values[view, ...] for key, values in start.items()}
        return list(run_over_others(graphs, name, view, of_views, before).values())

    results = graphs.map(results_of, range(len(next(iter(start.values())))))
    return [np.stack(of_result) for of_result in zip(*results, strict=True)]
