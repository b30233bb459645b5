"""Canonical form of an exported graph: equal computations have equal bytes, whatever names and order the exporter used.

Nodes are sorted depth first from the outputs, values are numbered in this order, initializers are sorted by their first
use, attributes by name. Variable dimensions get the names of the specification.
"""

from collections.abc import Iterator, MutableSequence
from typing import Any

import onnx
from onnx import NodeProto, TensorProto

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
    _replace(graph.initializer, [_renamed_tensor(tensor, names) for tensor in used])
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


def _renamed_tensor(tensor: TensorProto, names: dict[str, str]) -> TensorProto:
    renamed = TensorProto()
    renamed.CopyFrom(tensor)
    renamed.name, renamed.doc_string = names.get(tensor.name, tensor.name), ""
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
