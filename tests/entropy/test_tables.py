"""The tables are the data they claim to be."""

import math
from pathlib import Path

import numpy as np
import pytest

from fecocodec.entropy.tables import (
    FILE_NAME,
    FIRST_CODED_TABLE,
    NARROW_SIGMA,
    NUM_TABLES,
    SHA256,
    WIDE_SHARE,
    WIDE_SIGMA,
    load_tables,
    parse_tables,
)
from fecocodec.errors import ModelError

ROOT = Path(__file__).resolve().parents[2]
TOTAL = 1 << 24
LEAST_FREQUENCY = 16  # an outlier within the table costs at most 20 bits
LEAST_ESCAPE_FREQUENCY = 256  # an escape costs 16 bits plus its own code; reserving it costs 0.00002 bits a symbol


def upper_tail(sigmas: float) -> float:
    """Probability that the mixture of standard deviation 1 exceeds this value."""
    narrow, wide = (math.erfc(sigmas / (sigma * math.sqrt(2.0))) for sigma in (NARROW_SIGMA, WIDE_SIGMA))
    return 0.5 * ((1.0 - WIDE_SHARE) * narrow + WIDE_SHARE * wide)


def frequencies_of(sigma: float) -> list[int]:
    """Return the integer frequencies of the symbols -reach..reach and, last, of the escape: how the file was made."""
    reach = math.ceil(8.0 * sigma) + 1
    escape = LEAST_ESCAPE_FREQUENCY + round(2.0 * upper_tail((reach + 0.5) / sigma) * TOTAL)
    to_share = TOTAL - escape - (2 * reach + 1) * LEAST_FREQUENCY
    half = []
    for magnitude in range(reach, 0, -1):
        mass = upper_tail((magnitude - 0.5) / sigma) - upper_tail((magnitude + 0.5) / sigma)
        half.append(LEAST_FREQUENCY + math.floor(mass * to_share))
    return [*half, TOTAL - 2 * sum(half) - escape, *reversed(half), escape]


def test_every_table_is_symmetric_positive_and_sums_to_2_24():
    tables = load_tables()
    assert len(tables) == NUM_TABLES
    for table in tables:
        within, escape = table.frequencies[:-1].astype(np.int64), int(table.frequencies[table.escape])
        assert len(within) == 2 * table.reach + 1
        assert int(within.sum()) + escape == TOTAL
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
    text = (ROOT / "bitstream_spec" / "ENTROPY.md").read_text()
    assert SHA256 in text


def test_a_changed_byte_is_refused():
    data = bytearray((ROOT / "fecocodec" / "entropy" / FILE_NAME).read_bytes())
    data[1000] ^= 1
    with pytest.raises(ModelError, match="SHA-256"):
        parse_tables(bytes(data))


def test_the_tables_are_those_of_the_mixture():
    """Holds wherever the C library's erfc is accurate to a few units in the last place."""
    for index, table in enumerate(load_tables()):
        assert table.frequencies.tolist() == frequencies_of(2.0 ** ((index - 22) / 7))
