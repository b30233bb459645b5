"""The receiver without torch decodes all vectors to the same symbols and refuses all faulty ones."""

import json

import numpy as np
import pytest
import torch

from fecocodec.coding.quadtree import from_coding_order
from fecocodec.container import Stream, check_symbol_digest, read_stream
from fecocodec.errors import BitstreamError, ModelError
from fecocodec.model_files import find_receiver
from fecocodec.runtime.decode import StageLatents, decode_stage
from fecocodec.runtime.graphs import Graphs, graphs_of
from tests.vectors.paper_model import PAPER_MODEL, paper_model_id
from tests.vectors.symbols import check_detail, fingerprint
from tests.vectors.tiny_graphs import tiny_graphs
from tests.vectors.tiny_model import VECTORS, tiny_model_id

EXPECTED = json.loads((VECTORS / "expected.json").read_text())


def graphs_for(model_id: bytes, num_threads: int) -> Graphs:
    if model_id == tiny_model_id():
        return tiny_graphs(num_threads)
    folder = PAPER_MODEL if model_id == paper_model_id() else find_receiver(model_id).parent
    return graphs_of(folder, model_id, num_threads)


def decode_symbols(stream: Stream, num_threads: int) -> list[StageLatents]:
    """Decode every stage. Raises BitstreamError if a digest differs."""
    header = stream.header
    graphs, found = graphs_for(header.model_id, num_threads), list[StageLatents]()
    size = (header.num_views, *(side // 32 for side in header.grid_size))
    for stage, payload in enumerate(stream.payloads, start=1):
        context = found[0].steps if found else None
        found.append(decode_stage(graphs, payload, size, header.lambda_q_of_stage(stage), stage, context))
        check_symbol_digest(header, stage, found[-1].digest())
    return found


def clipped(values: np.ndarray) -> str:
    return fingerprint(values.astype(np.int64).clip(-(1 << 24), 1 << 24))


@pytest.mark.parametrize(("number", "name"), [*enumerate(EXPECTED["good"])])
def test_every_symbol_and_value_is_the_expected_one(number: int, name: str) -> None:
    """Of every other stream on two threads."""
    found = decode_symbols(read_stream((VECTORS / name).read_bytes()), 1 + number % 2)
    for mine, stage in zip(found, EXPECTED["good"][name]["stages"], strict=True):
        y_hat = from_coding_order(torch.from_numpy(np.stack(mine.steps))).permute(0, 2, 3, 1).numpy()
        assert [fingerprint(batch) for batch in mine.symbols] == stage["symbols"]
        assert (clipped(mine.z_hat), clipped(y_hat)) == (stage["z_hat"], stage["y_hat"])


@pytest.mark.parametrize("name", EXPECTED["faulty"])
def test_a_faulty_stream_is_refused_with_the_same_sentence(name: str) -> None:
    with pytest.raises((BitstreamError, ModelError)) as caught:
        stream = read_stream((VECTORS / name).read_bytes())
        decode_symbols(stream, 1)
        check_detail(stream)
    assert EXPECTED["faulty"][name]["says"] in str(caught.value)
