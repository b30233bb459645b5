"""Exported graphs have one form: equal modules and weights give equal bytes, in every run.

The exported form of bilinear sampling is `grid_sample`, at borders and for positions that are no numbers too.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx
import pytest
import torch
import torch.nn.functional as F
from onnx import TensorProto, helper

from fecocodec.checkpoint import RECEIVER_FILE, model_id_of
from fecocodec.coding.payload import encode_latents
from fecocodec.coding.symbol_choice import no_price
from fecocodec.container import Stream, read_stream, write_stream
from fecocodec.decoding import decode
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode as decode_with_torch
from fecocodec.receiver.model import Receiver, load_receiver
from fecocodec.training.graphs.canonical import make_canonical
from fecocodec.training.graphs.exported_forms import BILINEAR, BORDER, sampled
from fecocodec.training.graphs.specification import GraphInput
from tests.bitstream_spec.second_reader import read_symbols
from tests.vectors.chosen_symbols import cells_covered, levels_of
from tests.vectors.gaussian_difference import beyond, difference
from tests.vectors.gaussian_samples import PAPER_STREAM, table
from tests.vectors.paper_model import CONFIG, make_paper_model
from tests.vectors.tiny_graphs import FOLDER as TINY_GRAPHS
from tests.vectors.tiny_model import VECTORS

INPUTS = {"x": GraphInput("2*rows", torch.float32), "y": GraphInput("2*rows", torch.float32)}


def exported(symbol: str, prefix: str, order: list[int]) -> onnx.ModelProto:
    """Return (x + c) * y, and a node that no output needs, with an exporter's names and order of nodes."""
    nodes = [
        helper.make_node("Add", ["x", f"{prefix}c"], [f"{prefix}sum"], name=f"{prefix}node", doc_string="trace"),
        helper.make_node("Neg", ["y"], [f"{prefix}unused"]),
        helper.make_node("Mul", [f"{prefix}sum", "y"], ["z"]),
    ]
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [f"2*{symbol}"]) for name in "xyz"]
    constants = [helper.make_tensor(f"{prefix}{name}", TensorProto.FLOAT, [1], [1.5]) for name in ("unused_c", "c")]
    graph = helper.make_graph([nodes[at] for at in order], prefix, values[:2], values[2:], constants)
    return helper.make_model(graph, producer_name=prefix)


def canonical(model: onnx.ModelProto) -> bytes:
    make_canonical(model, INPUTS)
    onnx.checker.check_model(model)
    return model.SerializeToString(deterministic=True)


def test_forms_do_not_keep_names_and_order_of_the_exporter() -> None:
    first, second = exported("s1", "a_", [0, 1, 2]), exported("s77", "b_", [1, 0, 2])
    assert canonical(first) == canonical(second)
    assert [node.op_type for node in first.graph.node] == ["Add", "Mul"]
    assert [tensor.name for tensor in first.graph.initializer] == ["constant_0"]
    assert first.graph.output[0].type.tensor_type.shape.dim[0].dim_param == "2*rows"
    other = exported("s1", "a_", [0, 1, 2])
    other.graph.node[2].op_type = "Div"
    assert canonical(other) != canonical(exported("s1", "a_", [0, 1, 2]))


def test_subgraphs_are_refused() -> None:
    model = exported("s1", "a_", [0, 1, 2])
    body = helper.make_graph([], "body", [], [])
    model.graph.node.append(helper.make_node("If", ["x"], ["w"], then_branch=body, else_branch=body))
    with pytest.raises(ValueError, match="subgraphs have no canonical form"):
        make_canonical(model, INPUTS)


@pytest.mark.slow
def test_an_export_equals_the_shipped_graphs(tmp_path: Path) -> None:
    """A process of its own, with other hashes of strings; it also runs without the checks of types of the tests."""
    subprocess.run([sys.executable, "-m", "tests.vectors.tiny_graphs", str(tmp_path)], check=True)
    shipped = {path.name: path.read_bytes() for path in TINY_GRAPHS.iterdir()}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == shipped, "run `make graphs`"


def coded_anew(stream: Stream, receiver: Receiver, weights: bytes) -> Stream:
    """Return the stream with other latents, coded by a receiver's entropy model; the second reader must agree."""
    prior, header = receiver.prior, stream.header
    model, generator = read_symbols.read_model(weights), torch.Generator().manual_seed(0)
    size_8 = header.num_views, header.height // 8, header.width // 8
    payloads, digests, context, before = [], [], None, None
    for stage in (1, 2):
        y = 3.0 * torch.randn(size_8[0], prior.latent_channels, *size_8[1:], generator=generator)
        z = torch.randn(size_8[0], prior.hyper_channels, *(side // 4 for side in size_8[1:]), generator=generator)
        lambda_q = header.lambda_q_of_stage(stage)
        payload, coded = encode_latents(prior, y, z, lambda_q, stage, context, no_price)
        read = read_symbols.decode_stage(model, payload, size_8, lambda_q, stage, before)
        context, before = coded.y_hat, read.y_hat
        payloads.append(payload)
        digests.append(coded.digest())
        assert read.digest == digests[-1]
    return replace(stream, payloads=tuple(payloads), header=replace(header, symbol_digests=tuple(digests)))


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "change", [{"gaussians_per_side": 1}, {"gaussians_per_side": 4}, {"codes_stages_apart": True}, {"sh_degree": 0}]
)
def test_graphs_of_other_models_agree_with_torch(change: dict[str, Any], tmp_path: Path) -> None:
    """Other resolutions, stages coded apart, constant colours; with faded blocks and cells that are not covered."""
    weights = make_paper_model(replace(CONFIG, **change))
    (tmp_path / RECEIVER_FILE).write_bytes(weights)
    subprocess.run([sys.executable, "-m", "fecocodec.training.graphs", str(tmp_path)], check=True)
    receiver, _ = load_receiver(tmp_path / RECEIVER_FILE)
    stream = coded_anew(read_stream((VECTORS / PAPER_STREAM).read_bytes()), receiver, weights)
    header = replace(stream.header, model_id=model_id_of(weights))
    changes = {"coverage": cells_covered(header, 2), "fading": levels_of(header)}
    for changed in ({}, changes):
        data = write_stream(replace(stream, header=header, **changed))
        found = decode(data, model=tmp_path).gaussians
        expected = decode_with_torch(data, model=tmp_path).gaussians
        tensors = Gaussians(*(torch.from_numpy(field) for field in found.fields()))
        worst = difference(data, table(expected), table(tensors))
        assert beyond(worst, "full") == [], worst


def test_samples_are_those_of_grid_sample() -> None:
    generator = torch.Generator().manual_seed(0)
    values = torch.rand(3, 5, 6, 9, generator=generator)
    positions = 6.0 * torch.rand(3, 7, 8, 2, generator=generator) - 3.0
    positions[0, 0, :4] = torch.tensor([[-1.0, -1.0], [1.0, 1.0], [1.0, -1.0], [1e20, -1e20]])
    expected = F.grid_sample(values, positions, padding_mode="border", align_corners=False)
    found = sampled(values, positions, BILINEAR, BORDER, align_corners=False)
    torch.testing.assert_close(found, expected, rtol=0.0, atol=2e-6)
    values, positions = torch.rand(1, 2, 4, 4), torch.zeros(1, 1, 2, 2)
    positions[0, 0, 0] = torch.nan
    found = sampled(values, positions, BILINEAR, BORDER, align_corners=False)
    torch.testing.assert_close(found[..., 1], values[:, :, 1:3, 1:3].mean(dim=(2, 3))[..., None])


@pytest.mark.parametrize(("mode", "padding", "align_corners"), [(1, BORDER, False), (BILINEAR, 0, False), (0, 1, True)])
def test_other_modes_are_refused(mode: int, padding: int, align_corners: bool) -> None:
    with pytest.raises(ValueError, match="has an exported form"):
        sampled(torch.rand(1, 1, 4, 4), torch.zeros(1, 1, 1, 2), mode, padding, align_corners)
