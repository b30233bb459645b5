"""Readers return the symbols of writers, and payloads follow the specification."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fecocodec.entropy.symbol_coders import SymbolReader, SymbolWriter, symbol_digest
from fecocodec.entropy.tables import FIRST_CODED_TABLE, SYMBOL_LIMIT
from fecocodec.errors import BitstreamError
from tests.bitstream_spec.second_reader import read_symbols

SECOND_TABLES = read_symbols.read_tables(read_symbols.TABLES.read_bytes())
Batches = list[tuple[np.ndarray, np.ndarray]]

SYMBOLS = st.one_of(
    st.integers(-3, 3), st.integers(-400, 400), st.integers(-SYMBOL_LIMIT, SYMBOL_LIMIT), st.integers(-(2**40), 2**40)
)
BATCH = st.lists(st.tuples(st.integers(0, 63), SYMBOLS), max_size=40).map(
    lambda pairs: (
        np.array([table for table, _ in pairs], dtype=np.int64),
        np.array([symbol for _, symbol in pairs], dtype=np.int64),
    )
)


def write(batches: Batches) -> tuple[bytes, list[np.ndarray]]:
    writer = SymbolWriter()
    kept = [writer.exchange(tables, symbols) for tables, symbols in batches]
    return writer.finish(), kept


def is_noticed(payload: bytes, tables: np.ndarray, digest: bytes) -> bool:
    try:
        reader = SymbolReader(payload)
        decoded = reader.exchange(tables, None)
        reader.finish()
    except BitstreamError:
        return True
    return symbol_digest([decoded]) != digest


def gaussian_batch(seed: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    tables = rng.integers(0, 64, size)
    return tables, np.round(rng.normal(size=size) * 2.0 ** ((tables - 22) / 7)).astype(np.int64)


@settings(max_examples=150, deadline=None)
@given(st.lists(BATCH, max_size=4))
def test_round_trip_of_any_symbols(batches: Batches):
    payload, kept = write(batches)
    reader = SymbolReader(payload)
    for (tables, symbols), mine in zip(batches, kept, strict=True):
        expected = np.where(tables < FIRST_CODED_TABLE, 0, symbols.clip(-SYMBOL_LIMIT, SYMBOL_LIMIT))
        assert np.array_equal(mine, expected)
        assert np.array_equal(reader.exchange(tables, None), expected)
    reader.finish()


@settings(max_examples=40, deadline=None)
@given(st.lists(BATCH, max_size=3))
def test_payload_is_what_the_specification_says(batches: Batches):
    payload, kept = write(batches)
    coder = read_symbols.Coder(payload)
    for (tables, _), mine in zip(batches, kept, strict=True):
        assert read_symbols.take_batch(coder, SECOND_TABLES, tables.tolist()) == mine.tolist()
    assert coder.state == 0 and not coder.words


def test_examples():
    tables, symbols = np.array([22, 3, 40, 22, 6]), np.array([1, 0, -500, -2, 0])
    payload, _ = write([(tables, symbols)])
    assert payload.hex(" ") == "90 39 c3 23 8a 3c 09 00"
    coder = read_symbols.Coder(payload)
    assert read_symbols.take_batch(coder, SECOND_TABLES, tables.tolist()) == symbols.tolist()
    assert symbol_digest([np.array([1, -1]), np.array([[2]])]).hex() == "80c7482143097006"
    # All ones select the last entries: escape, exponent 31.
    with pytest.raises(BitstreamError, match="exponent 31"):
        SymbolReader(b"\xff" * 64).exchange(np.array([30]), None)


def test_nothing_coded_is_an_empty_payload():
    tables = np.zeros((2, 3), dtype=np.int64)
    payload, kept = write([(tables, np.full((2, 3), 7))])
    assert payload == b"" and not kept[0].any()
    reader = SymbolReader(payload)
    assert np.array_equal(reader.exchange(tables, None), kept[0])
    reader.finish()


def test_damaged_payloads_are_noticed():
    """A state that ends empty encodes exactly the symbols read, so damage must change them or be detected."""
    tables, symbols = gaussian_batch(seed=2, size=500)
    payload, kept = write([(tables, symbols)])
    rng = np.random.default_rng(3)
    for _ in range(200):
        damaged = bytearray(payload)
        damaged[rng.integers(len(payload))] ^= 1 << rng.integers(8)
        assert is_noticed(bytes(damaged), tables, symbol_digest(kept))
    for cut in range(len(payload)):
        assert is_noticed(payload[:cut], tables, symbol_digest(kept))


@pytest.mark.parametrize("payload", [b"\1", b"\1\2\3\4\5", bytes(4), b"\1\0\0\0" + bytes(4)])
def test_bytes_that_are_no_words_are_refused(payload: bytes):
    with pytest.raises(BitstreamError, match="32-bit words"):
        SymbolReader(payload)
