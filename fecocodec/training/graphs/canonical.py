"""What is done to an exported graph: its canonical form, and weights that refer to the weights file.

Equal computations have equal bytes, whatever names and order the exporter used. Nodes are sorted depth first from the
outputs, values are numbered in this order, initializers are sorted by their first use, attributes by name. Variable
dimensions get the names of the specification.

An ONNX model may store a tensor outside its file: file name, offset and length. Safetensors stores tensors as plain
little-endian arrays, so a weights file serves as this external file as it is. Floats are fp16 there; a Cast to float32
follows, which runtimes fold when they load a graph.
"""

import json
from collections.abc import Iterator, MutableSequence
from typing import Any

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from fecocodec.training.graphs.specification import GraphInput


def make_canonical(model: onnx.ModelProto, inputs: dict[str, GraphInput]) -> None:
    """Bring a model to its canonical form, in place. inputs: specification of its inputs.

    Raises ValueError if the model has functions or subgraphs, which are not handled.
    """
    graph = model.graph
    if model.functions or any(attribute.HasField("g") for node in graph.node for attribute in node.attribute):
        raise ValueError(f"{graph.name}: graphs with functions or subgraphs have no canonical form; change the module.")
    nodes = _depth_first(graph)
    names = _value_names(graph, nodes)
    constants = {tensor.name: tensor for tensor in graph.initializer}
    used = [constants[name] for name in dict.fromkeys(_inputs_of(nodes)) if name in constants]
    _replace(graph.node, [_renamed_node(node, names) for node in nodes])
    _replace(graph.initializer, used)
    for tensor in graph.initializer:
        tensor.name, tensor.doc_string = names.get(tensor.name, tensor.name), ""
    _name_dimensions(graph, inputs)
    _remove_notes(model)


def _depth_first(graph: onnx.GraphProto) -> list[NodeProto]:
    """Return the nodes that the outputs need, each after the nodes of its inputs, in the order of inputs."""
    producers = {name: node for node in graph.node for name in node.output if name}
    done: dict[str, NodeProto] = {}  # by the first output
    waiting = [output.name for output in reversed(graph.output)]
    while waiting:
        node = producers.get(waiting[-1])
        if node is None or node.output[0] in done:
            waiting.pop()
            continue
        of_inputs = (producers[name] for name in node.input if name in producers)
        missing = next((before for before in of_inputs if before.output[0] not in done), None)
        if missing is None:
            done[node.output[0]] = node
        else:
            waiting.append(missing.output[0])
    return list(done.values())


def _value_names(graph: onnx.GraphProto, nodes: list[NodeProto]) -> dict[str, str]:
    """Return new names of values. Inputs, outputs and references to the weights file keep theirs."""
    kept = {value.name for value in (*graph.input, *graph.output)} | {""}
    kept |= {tensor.name for tensor in graph.initializer if tensor.external_data}
    constants = {tensor.name for tensor in graph.initializer} - kept
    used = dict.fromkeys(name for name in _inputs_of(nodes) if name in constants)
    computed = dict.fromkeys(name for node in nodes for name in node.output if name not in kept)
    return {name: f"constant_{number}" for number, name in enumerate(used)} | {
        name: f"value_{number}" for number, name in enumerate(computed)
    }


def _inputs_of(nodes: list[NodeProto]) -> Iterator[str]:
    return (name for node in nodes for name in node.input)


def _renamed_node(node: NodeProto, names: dict[str, str]) -> NodeProto:
    """Return a node with new names of its values, sorted attributes, and without its own name and notes."""
    renamed = NodeProto(op_type=node.op_type, domain=node.domain)
    renamed.input.extend(names.get(name, name) for name in node.input)
    renamed.output.extend(names.get(name, name) for name in node.output)
    renamed.attribute.extend(sorted(node.attribute, key=lambda attribute: attribute.name))
    for attribute in renamed.attribute:
        attribute.doc_string = ""
    return renamed


def _replace(field: MutableSequence[Any], values: list[Any]) -> None:
    del field[:]
    field.extend(values)


def _name_dimensions(graph: onnx.GraphProto, inputs: dict[str, GraphInput]) -> None:
    """Replace the exporter's symbols in variable dimensions by the names of the specification."""
    symbols = {}
    for value in graph.input:
        words = inputs[value.name].shape.split()
        for word, dimension in zip(words, value.type.tensor_type.shape.dim, strict=True):
            if dimension.dim_param:
                symbols[dimension.dim_param.rpartition("*")[2]] = word.rpartition("*")[2]
    for value in (*graph.input, *graph.output):
        for dimension in value.type.tensor_type.shape.dim:
            if dimension.dim_param:
                factors = dimension.dim_param.split("*")
                renamed = (factor if factor.isdecimal() else symbols[factor] for factor in factors)
                dimension.dim_param = "*".join(sorted(renamed))


def _remove_notes(model: onnx.ModelProto) -> None:
    """Remove what only the exporter's developers read: stack traces, versions, and types of inner values."""
    model.producer_name, model.producer_version, model.doc_string = "", "", ""
    graph = model.graph
    graph.name, graph.doc_string = "graph", ""
    for field in (graph.value_info, graph.metadata_props, graph.quantization_annotation, model.metadata_props):
        del field[:]
    for value in (*graph.input, *graph.output):
        del value.metadata_props[:]
        value.doc_string = ""


_TYPES: dict[str, np.dtype[Any]] = {"F16": np.dtype("<f2"), "I16": np.dtype("<i2"), "I32": np.dtype("<i4")}
_STORED = "stored."  # prefix of an fp16 initializer
SMALLEST_LINKED = 256  # bytes; smaller tensors stay in the graph


def link_weights(model: onnx.ModelProto, weights: bytes, file_name: str) -> None:
    """Replace, in place, the initializers that a weights file has by references to it.

    file_name: of the weights file, relative to the graph. Raises ValueError if an initializer differs from the tensor
    of its name.
    """
    header_size = int.from_bytes(weights[:8], "little")
    entries = json.loads(weights[8 : 8 + header_size])
    kept, casts = [], []
    for initializer in model.graph.initializer:
        entry = entries.get(initializer.name.removeprefix("receiver."))
        if entry is None or len(initializer.raw_data) < SMALLEST_LINKED:
            kept.append(initializer)
            continue
        begin, end = (8 + header_size + offset for offset in entry["data_offsets"])
        linked = _reference(initializer, entry, begin, end - begin, file_name)
        _require_equal(initializer, entry, weights[begin:end])
        if linked.data_type != initializer.data_type:
            linked.name = _STORED + initializer.name
            casts.append(helper.make_node("Cast", [linked.name], [initializer.name], to=initializer.data_type))
        kept.append(linked)
    _replace(model.graph.initializer, kept)
    _replace(model.graph.node, [*casts, *model.graph.node])


def _reference(
    initializer: TensorProto, entry: dict[str, object], offset: int, length: int, file_name: str
) -> TensorProto:
    data_type = helper.np_dtype_to_tensor_dtype(_TYPES[str(entry["dtype"])])
    linked = TensorProto(name=initializer.name, data_type=data_type, dims=initializer.dims)
    linked.data_location = TensorProto.EXTERNAL
    for key, value in (("location", file_name), ("offset", offset), ("length", length)):
        linked.external_data.add(key=key, value=str(value))
    return linked


def _require_equal(initializer: TensorProto, entry: dict[str, object], stored: bytes) -> None:
    values = np.frombuffer(stored, _TYPES[str(entry["dtype"])])
    ours = numpy_helper.to_array(initializer)
    if list(ours.shape) != entry["shape"] or not np.array_equal(ours.ravel(), values.astype(ours.dtype)):
        raise ValueError(f"{initializer.name}: the graph's tensor differs from that of the weights file.")
