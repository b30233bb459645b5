"""The tables are the data they claim to be."""

from pathlib import Path

import numpy as np
import pytest

from fecocodec.entropy.make_tables import serialise_tables
from fecocodec.entropy.tables import FIRST_CODED_TABLE, NUM_TABLES, SHA256, load_tables, parse_tables
from fecocodec.errors import ModelError


def test_every_table_is_symmetric_positive_and_sums_to_2_24():
    tables = load_tables()
    assert len(tables) == NUM_TABLES
    for table in tables:
        within, escape = table.frequencies[:-1].astype(np.int64), int(table.frequencies[table.escape])
        assert len(within) == 2 * table.reach + 1
        assert int(within.sum()) + escape == 1 << 24
        assert within.min() >= 1 and escape >= 1
        assert np.array_equal(within, within[::-1])
        assert np.all(np.diff(within[: table.reach + 1]) >= 0), "frequencies fall with distance from zero"


def test_tables_widen_by_a_seventh_of_an_octave():
    spreads = []
    for table in load_tables():
        symbols = np.arange(-table.reach, table.reach + 1)
        spreads.append(np.sqrt((symbols**2 * table.frequencies[:-1]).sum() / 2.0**24))
    expected = 2.0 ** ((np.arange(NUM_TABLES) - 22) / 7)
    rounded = np.sqrt(expected**2 + 1 / 12)  # variance of a rounded Gaussian, for standard deviations above about 0.5
    assert np.allclose(spreads[16:], rounded[16:], rtol=0.02)
    assert np.all(np.diff(spreads[FIRST_CODED_TABLE:]) > 0)


def test_the_specification_names_the_shipped_file():
    text = (Path(__file__).resolve().parents[2] / "bitstream_spec" / "ENTROPY.md").read_text()
    assert SHA256 in text


def test_a_changed_byte_is_refused():
    data = bytearray(serialise_tables())
    data[1000] ^= 1
    with pytest.raises(ModelError, match="SHA-256"):
        parse_tables(bytes(data))


def test_the_script_makes_the_shipped_file():
    """Holds wherever the C library's erfc is accurate to a few units in the last place."""
    made = parse_tables(serialise_tables())
    assert all(np.array_equal(a.frequencies, b.frequencies) for a, b in zip(made, load_tables(), strict=True))
