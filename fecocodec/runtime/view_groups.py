"""Run graphs that treat every view alike on a few views at a time, so that their maps stay small and in the cache."""

from collections.abc import Callable
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

    def run(graphs: Graphs, group: slice) -> list[np.ndarray]:
        return graphs.run(name, **inputs_of(group))

    results = graphs.map(run, groups) if is_parallel else [run(graphs, group) for group in groups]
    return results[0] if len(results) == 1 else [np.concatenate(parts, axis) for parts in zip(*results, strict=True)]


def groups_of_views(grid: tuple[int, int, int], num_threads: int) -> tuple[list[slice], bool]:
    """Return groups of views, and whether every thread can have a group of its own within CELLS_AT_ONCE."""
    views, cells = grid[0], grid[1] * grid[2]
    is_parallel = cells * num_threads <= CELLS_AT_ONCE
    at_once = num_threads if is_parallel else 1
    size = min(max(1, CELLS_AT_ONCE // (at_once * cells)), -(-views // at_once))
    return [slice(first, first + size) for first in range(0, views, size)], is_parallel
