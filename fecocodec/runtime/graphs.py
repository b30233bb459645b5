"""Graphs of a receiver, run by onnxruntime: one call, or a few views at a time, so that maps stay in the cache.

Only this file imports onnxruntime.

Its wheels send telemetry to their vendor, which is switched off here. That is too late for a first event on import: the
command line sets ORT_DISABLE_TELEMETRY before, and programs should do so too (docs/python.md).
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import numpy as np
import onnxruntime
from jaxtyping import Shaped, UInt8

from fecocodec.errors import ModelError
from fecocodec.limits import num_cores
from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, read_bytes, receiver_kind

Item = TypeVar("Item")
Result = TypeVar("Result")

onnxruntime.disable_telemetry_events()
CELLS_AT_ONCE = 2**15  # of the 1/4 grid, in all threads; 16 MiB for a map of 128 channels


class Graphs:
    """Graphs of one model; each is loaded on its first use. weights: content of the receiver's weights file."""

    def __init__(self, weights: bytes, folder: Path, model_id: bytes, num_threads: int) -> None:
        """weights: to which the graphs refer. num_threads: 0 for all cores."""
        self.weights, self._folder, self._model_id = weights, folder, model_id.hex()
        self.kind = receiver_kind(weights)
        self.num_threads = num_threads or num_cores()
        self._sessions: dict[str, onnxruntime.InferenceSession] = {}
        self._loading = Lock()
        self._of_one_thread = self
        if self.num_threads > 1:
            self._of_one_thread = Graphs(weights, folder, model_id, num_threads=1)

    def run(self, name: str, **inputs: Shaped[np.ndarray, "..."] | int) -> list[np.ndarray]:
        """Run the graph NAME.onnx; returns its outputs in their order. An int is passed as an int32 scalar.

        Raises ModelError if the file is missing or was exported from other weights.
        """
        session = self._session(name)
        arrays = {key: np.int32(value) if isinstance(value, int) else value for key, value in inputs.items()}
        outputs: list[np.ndarray] = session.run(None, {key: np.asarray(value) for key, value in arrays.items()})
        return outputs

    def input_names(self, name: str) -> list[str]:
        """Return the names of a graph's inputs."""
        return [of.name for of in self._session(name).get_inputs()]

    def map(self, function: Callable[["Graphs", Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return function(graphs, item) of all items, computed in parallel; the graphs given to it run on one thread.

        This is faster than one item after another on several threads: a core works on maps that are in its own cache.
        """
        if self.num_threads == 1 or len(items) < 2:
            return [function(self, item) for item in items]
        with ThreadPoolExecutor(self.num_threads) as pool:
            return list(pool.map(function, [self._of_one_thread] * len(items), items))

    def input_shape(self, name: str, input_name: str) -> list[int | str]:
        """Return the shape of an input; variable dimensions are strings."""
        shapes: dict[str, list[int | str]] = {of.name: of.shape for of in self._session(name).get_inputs()}
        return shapes[input_name]

    def _session(self, name: str) -> onnxruntime.InferenceSession:
        with self._loading:
            if name not in self._sessions:
                self._sessions[name] = self._load(name)
            return self._sessions[name]

    def _load(self, name: str) -> onnxruntime.InferenceSession:
        path = self._folder / f"{name}.onnx"
        if not path.is_file():
            raise ModelError(
                f"{path}: the graph is missing, so the model cannot be decoded without torch; make it with "
                f"`python -m fecocodec.training.graphs {self._folder.parent}`."
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.num_threads
        options.log_severity_level = 3
        options.enable_cpu_mem_arena = False  # each graph would keep the memory of its largest run
        options.add_external_initializers_from_files_in_memory([RECEIVER_FILE], [self.weights], [len(self.weights)])
        try:
            session = onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises several classes that share no base of their own
            raise ModelError(f"{path}: onnxruntime cannot load this graph; reinstall the package.") from error
        found = session.get_modelmeta().custom_metadata_map.get("model_id")
        if found != self._model_id:
            raise ModelError(
                f"{path}: it was exported from weights with model id {found}, not {self._model_id}; make it again with "
                f"`python -m fecocodec.training.graphs {self._folder.parent}`."
            )
        return session


@lru_cache(maxsize=2)
def graphs_of(folder: Path, model_id: bytes, num_threads: int) -> Graphs:
    """Return the graphs of the receiver in a model's folder. Raises ModelError if its weights cannot be read.

    model_id: of these weights; it is a part of the key under which the graphs are kept, as weights can be replaced.
    """
    return Graphs(read_bytes(folder / RECEIVER_FILE), folder / GRAPHS_FOLDER, model_id, num_threads)


def bytes_tensor(weights: bytes, name: str) -> UInt8[np.ndarray, "..."] | None:
    """Return a tensor of bytes (U8) of a weights file, without torch; None if the file has no tensor of this name.

    weights: a valid weights file (safetensors, ENTROPY.md, section 6.1).
    """
    size = int.from_bytes(weights[:8], "little")
    entry = json.loads(weights[8 : 8 + size]).get(name)
    if entry is None:
        return None
    begin, end = entry["data_offsets"]
    return np.frombuffer(weights[8 + size + begin : 8 + size + end], np.uint8).reshape(entry["shape"])


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
    in the outputs, which can have several entries for each view. Groups are run in parallel if every thread can have
    one, else one after another.
    """
    groups, is_parallel = groups_of_views(grid, graphs.num_threads)
    if len(groups) == 1:
        return graphs.run(name, **inputs_of(groups[0]))
    outputs, making, before = list[np.ndarray](), Lock(), (slice(None),) * axis

    def run(graphs: Graphs, group: slice) -> None:
        """Copy the outputs of a group into those of all views, so that they are freed soon."""
        parts = graphs.run(name, **inputs_of(group))
        per_view = [part.shape[axis] // (group.stop - group.start) for part in parts]
        with making:
            if not outputs:
                for part, count in zip(parts, per_view, strict=True):
                    shape = (*part.shape[:axis], count * grid[0], *part.shape[axis + 1 :])
                    outputs.append(np.empty(shape, part.dtype))
        for whole, part, count in zip(outputs, parts, per_view, strict=True):
            whole[*before, group.start * count : group.stop * count] = part

    if is_parallel:
        graphs.map(run, groups)
    else:
        for group in groups:
            run(graphs, group)
    return outputs


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
