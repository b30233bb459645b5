"""The golden streams: exact in bytes and symbols, tolerant in Gaussians."""

import json
from pathlib import Path

import pytest

from tests.vectors.make_vectors import VECTORS, expectation

EXPECTED = json.loads((VECTORS / "expected.json").read_text())
TOLERANCE = 1e-3  # of a statistic, relative to itself or 1e-3 absolute: floating point differs between machines


def test_there_is_a_stream_for_every_expectation_and_no_other() -> None:
    streams = {path.relative_to(VECTORS).as_posix() for path in Path(VECTORS).glob("*/*.fcs")}
    assert streams == set(EXPECTED) and streams


@pytest.mark.parametrize("name", EXPECTED)
def test_a_golden_stream_decodes_to_what_it_did_when_it_was_made(name: str) -> None:
    """Decoding compares the symbols' digests with the header's, so symbols are exact where it succeeds."""
    found, expected = expectation((VECTORS / name).read_bytes()), EXPECTED[name]
    for exact in ("sha256", "model_id", "symbol_digests"):
        assert found[exact] == expected[exact]
    assert found["num_gaussians"] == pytest.approx(
        expected["num_gaussians"], rel=TOLERANCE
    )  # a few are almost too faint
    for stage, fields in expected["gaussians"].items():
        for field, statistics in fields.items():
            assert found["gaussians"][stage][field] == pytest.approx(statistics, rel=TOLERANCE, abs=TOLERANCE), field
