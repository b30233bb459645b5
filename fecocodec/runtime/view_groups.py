"""Run graphs that treat every view alike on a few views at a time, so that their maps stay small and in the cache."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from fecocodec.runtime.graphs import Graphs

CELLS_AT_ONCE = 2**14  # of the 1/4 grid; 8 MiB for a map of 128 channels


def run_by_views(
    graphs: Graphs, name: str, grid: tuple[int, int, int], inputs_of: Callable[[slice], dict[str, Any]]
) -> list[np.ndarray]:
    """Run a graph on groups of views and return its outputs, whose first axis is ordered by view.

    grid: views, rows and columns of the 1/4 grid. inputs_of: returns the inputs of a group of views.
    """
    results = [graphs.run(name, **inputs_of(group)) for group in groups_of_views(*grid)]
    return results[0] if len(results) == 1 else [np.concatenate(parts) for parts in zip(*results, strict=True)]


def groups_of_views(views: int, rows: int, columns: int) -> Iterator[slice]:
    """Yield groups of at least one view and, if that is more, of up to CELLS_AT_ONCE cells."""
    size = max(1, CELLS_AT_ONCE // (rows * columns))
    for first in range(0, views, size):
        yield slice(first, first + size)
