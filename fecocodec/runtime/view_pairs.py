"""Run graphs that compare the Gaussians of one view with another view of the scene."""

import numpy as np

from fecocodec.runtime.graphs import Graphs

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
