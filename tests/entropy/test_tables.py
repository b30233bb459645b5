"""The tables are those of the specification, whose file is frozen by its SHA-256."""

from pathlib import Path

import pytest

from fecocodec.entropy.tables import (
    FILE_NAME,
    SHA256,
    parse_tables,
)
from fecocodec.errors import ModelError

ROOT = Path(__file__).resolve().parents[2]


def test_the_tables_are_those_of_the_specification():
    text = (ROOT / "bitstream_spec" / "ENTROPY.md").read_text()
    assert SHA256 in text
    data = bytearray((ROOT / "fecocodec" / "entropy" / FILE_NAME).read_bytes())
    data[1000] ^= 1
    with pytest.raises(ModelError, match="SHA-256"):
        parse_tables(bytes(data))
