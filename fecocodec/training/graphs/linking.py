"""Link the initializers of a graph to the weights file, so that graphs hold no weights of their own.

An ONNX model may store a tensor outside its file: file name, offset and length. Safetensors stores tensors as plain
little-endian arrays, so a weights file serves as this external file as it is. Floats are fp16 there; a Cast to float32
follows, which runtimes fold when they load a graph.
"""

import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

_TYPES = {"F16": TensorProto.FLOAT16, "I16": TensorProto.INT16, "I32": TensorProto.INT32}
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
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)


def _reference(
    initializer: TensorProto, entry: dict[str, object], offset: int, length: int, file_name: str
) -> TensorProto:
    linked = TensorProto(name=initializer.name, data_type=_TYPES[str(entry["dtype"])], dims=initializer.dims)
    linked.data_location = TensorProto.EXTERNAL
    for key, value in (("location", file_name), ("offset", offset), ("length", length)):
        linked.external_data.add(key=key, value=str(value))
    return linked


def _require_equal(initializer: TensorProto, entry: dict[str, object], stored: bytes) -> None:
    values = np.frombuffer(stored, {"F16": "<f2", "I16": "<i2", "I32": "<i4"}[str(entry["dtype"])])
    ours = numpy_helper.to_array(initializer)
    if list(ours.shape) != entry["shape"] or not np.array_equal(ours.ravel(), values.astype(ours.dtype)):
        raise ValueError(f"{initializer.name}: the graph's tensor differs from that of the weights file.")
