"""Export the receiver's networks to ONNX graphs, which hold no weights: they refer to the weights file."""

import logging
import os
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import torch
from onnxscript import optimizer

from fecocodec.atomic import make_folder, write_file
from fecocodec.checkpoint import RECEIVER_FILE, model_id_of
from fecocodec.model_files import GRAPHS_FOLDER
from fecocodec.progress import OnProgress, ignore_progress
from fecocodec.receiver.model import load_receiver
from fecocodec.training.graphs.canonical import link_weights, make_canonical
from fecocodec.training.graphs.exported_forms import sampled, with_exported_forms
from fecocodec.training.graphs.networks import network_graphs
from fecocodec.training.graphs.specification import Graph, prior_graphs

OPSET = 20  # the first with GELU
LARGEST_FOLDED = 1024  # bytes of a tensor that folding of constants may write into a graph
SUBSTITUTES = {torch.ops.aten.grid_sampler.default: sampled}  # for operators that onnxruntime computes slowly


def export_receiver(folder: Path, on_progress: OnProgress = ignore_progress) -> None:
    """Export all graphs of the receiver in a model's folder to its subfolder `graphs`, which takes minutes.

    Raises ModelError if the weights cannot be read, OutputError if the folder cannot be written.
    """
    path = folder / RECEIVER_FILE
    receiver = with_exported_forms(load_receiver(path)[0])
    graphs = network_graphs(receiver) | prior_graphs(receiver.prior)
    write_graphs(graphs, path.read_bytes(), folder / GRAPHS_FOLDER, on_progress)


def write_graphs(
    graphs: dict[str, Graph], weights: bytes, folder: Path, on_progress: OnProgress = ignore_progress
) -> None:
    """Write graphs of a weights file as NAME.onnx, with its model id as metadata. Raises OutputError if that fails.

    The graphs are exported by one process per core. Equal weights give equal bytes. The main module of the program must
    be importable (`if __name__ == "__main__"`).
    """
    make_folder(folder)
    on_progress("exporting the graphs", 0.0)
    with ProcessPoolExecutor(
        min(os.cpu_count() or 1, len(graphs)),
        mp_context=get_context("spawn"),
        initializer=torch.set_num_threads,
        initargs=(1,),
    ) as pool:
        contents = pool.map(export_graph, graphs, graphs.values(), repeat(weights))
        for done, (name, content) in enumerate(zip(graphs, contents, strict=True), start=1):
            write_file(folder / f"{name}.onnx", content, overwrite=True)
            on_progress("exporting the graphs", done / len(graphs))


def export_graph(name: str, graph: Graph, weights: bytes) -> bytes:
    """Return a graph as a serialised ONNX model whose large tensors refer to the weights file."""
    with torch.no_grad(), _quiet_exporter():
        exported = torch.export.export(
            graph.module.eval(),
            tuple(of.example() for of in graph.inputs.values()),
            dynamic_shapes=tuple(of.dynamic() for of in graph.inputs.values()),
            strict=False,
        ).run_decompositions(SUBSTITUTES)
        program = torch.onnx.export(
            exported,
            dynamo=True,
            opset_version=OPSET,
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            optimize=False,
            verbose=False,
        )
        assert program is not None
        optimizer.optimize_ir(program.model, output_size_limit=LARGEST_FOLDED, input_size_limit=LARGEST_FOLDED)
        model = program.model_proto
    link_weights(model, weights, RECEIVER_FILE)
    make_canonical(model, graph.inputs)
    for key, value in (("model_id", model_id_of(weights).hex()), ("graph", name)):
        model.metadata_props.add(key=key, value=value)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Hide the exporter's log lines and warnings."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
