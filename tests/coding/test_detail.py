"""Detail is read as it was written, in the order and with the tables that ENTROPY.md, section 7.2, defines."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fecocodec.checkpoint import serialise_weights
from fecocodec.coding.detail import (
    Choose,
    Size,
    code_detail,
    decode_detail,
    detail_size,
    detail_values,
    encode_detail,
)
from fecocodec.container import Detail
from fecocodec.entropy.symbol_coders import SymbolWriter
from fecocodec.entropy.tables import FIRST_CODED_TABLE, SYMBOL_LIMIT
from fecocodec.errors import BitstreamError, ModelError
from tests.bitstream_spec.second_reader import read_symbols
from tests.container.example_streams import example_stream

SIZE = (2, 4, 8)
EACH_BUCKET = np.arange(16, dtype=np.uint8)[None].repeat(2, axis=0)  # tables with which an index is its bucket
HEADER = replace(example_stream().header, height=64, width=96)  # two views of 8x12 blocks
SIZE_OF_HEADER = (2, 8, 12)


def random_tables(seed: int, planes: int = 6) -> np.ndarray:
    """Return tables, of which some code nothing, but not that of the first plane."""
    tables = np.random.default_rng(seed).integers(0, 25, (planes, 16), dtype=np.uint8)
    tables[0, 0] = 20
    return tables


def random_symbols(seed: int, planes: int = 6, size: Size = SIZE, spread: float = 2.0) -> np.ndarray:
    """Return symbols that are mostly small, with some beyond the reach of their tables and a few beyond the limit."""
    rng = np.random.default_rng(seed)
    symbols = np.round(spread * rng.standard_t(1.5, (planes, *size)))
    symbols[rng.random(symbols.shape) < 0.01] = 2**21
    return symbols.astype(np.int32)


def choose_from(symbols: np.ndarray) -> Choose:
    return lambda plane, _: symbols[plane]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [SIZE, (1, 4, 4), (3, 8, 4)])
def test_detail_is_read_as_written_and_as_the_specification_says(seed: int, size: Size) -> None:
    tables, wanted = random_tables(seed), random_symbols(seed, size=size)
    payload, sent = encode_detail(tables, choose_from(wanted), size)
    received = decode_detail(tables, payload, size)
    assert received.dtype == np.int32 and np.array_equal(received, sent)
    weights = serialise_weights({"detail.tables": torch.from_numpy(tables)}, {})
    planes = read_symbols.decode_detail(weights, payload, size)
    assert received.reshape(len(tables), -1).tolist() == planes


def test_symbols_that_are_coded_are_those_that_were_chosen() -> None:
    tables, wanted = random_tables(7), random_symbols(7)
    coded = list[np.ndarray]()

    def choose(plane: int, indices: np.ndarray) -> np.ndarray:
        assert plane == len(coded)
        coded.append(indices >= FIRST_CODED_TABLE)
        return wanted[plane]

    _, sent = encode_detail(tables, choose, SIZE)
    is_coded = np.array(coded)
    assert np.array_equal(sent, np.where(is_coded, wanted.clip(-SYMBOL_LIMIT, SYMBOL_LIMIT), 0))
    assert 0.05 < is_coded.mean() < 0.95, "both kinds are tried"
    assert np.abs(sent).max() == SYMBOL_LIMIT, "escapes are tried"


def test_the_example_of_the_specification_holds() -> None:
    first = np.array([[[0, 0, 0, 0], [0, 3, 0, 0], [0, -1, 0, 0], [0, 0, 0, 20]]], np.int32)
    seen = list[list[list[int]]]()

    def choose(plane: int, indices: np.ndarray) -> np.ndarray:
        seen.append(indices[0].tolist())
        return first

    tables = EACH_BUCKET.copy()
    tables[0] = 30  # so that the first plane is coded
    encode_detail(tables, choose, (1, 4, 4))
    assert seen == [[[30] * 4] * 4, [[0, 3, 0, 0], [3, 5, 3, 0], [1, 4, 1, 8], [0, 1, 8, 10]]]


def test_values_are_symbols_times_the_step() -> None:
    tables = random_tables(6, planes=3)
    payload, sent = encode_detail(tables, choose_from(random_symbols(6, 3, SIZE_OF_HEADER)), SIZE_OF_HEADER)
    assert detail_size(HEADER) == SIZE_OF_HEADER
    for step, size in ((0, 1.0), (8, 0.5), (63, 2.0**-7.875), (3, 2.0**-0.375)):
        values = detail_values(tables, Detail(step, payload), HEADER)
        assert values.dtype == np.float32 and values.shape == (2, 3, 8, 12) and values.flags.c_contiguous
        for plane in range(3):
            assert np.array_equal(values[:, plane], sent[plane].astype(np.float32) * np.float32(size))


def test_models_and_tables_that_do_not_fit_are_refused() -> None:
    with pytest.raises(BitstreamError, match=rf"^section detail: the model {b'modelid8'.hex()} has no detail; .*\.$"):
        detail_values(None, Detail(0, b""), HEADER)
    with pytest.raises(BitstreamError, match=r"^section detail: payload: its 5 bytes are not 32-bit words"):
        detail_values(random_tables(0), Detail(0, b"12345"), HEADER)
    tables = random_tables(0)
    tables[3, 5] = 64
    with pytest.raises(ModelError, match="names table 64"):
        decode_detail(tables, b"", SIZE)
    with pytest.raises(ValueError, match="pass the symbols to write"):
        code_detail(SymbolWriter(), np.full((1, 16), 30, np.uint8), SIZE, None)
