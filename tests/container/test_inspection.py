"""The summary of intact and damaged streams."""

from dataclasses import replace

import pytest

from fecocodec.container import Detail, inspect, list_sections, write_stream
from fecocodec.errors import BitstreamError
from tests.container.example_streams import example_stream
from tests.container.faulty_streams import EXAMPLE, GOOD


def test_a_whole_stream_is_described() -> None:
    summary = inspect(GOOD)
    assert summary.damage is None
    assert summary.header == example_stream().header
    assert summary.metadata == example_stream().metadata
    assert (summary.near, summary.far) == (0.5, 100.0)
    assert [section.name for section in summary.sections] == ["cameras", "B1", "B2", "metadata"]
    assert [section.offset for section in summary.sections] == [48, EXAMPLE.b1_offset, EXAMPLE.b2_offset, EXAMPLE.end]
    assert all(section.is_intact for section in summary.sections)
    assert summary.total_bytes == summary.overhead_bytes + sum(section.length for section in summary.sections)
    assert summary.overhead_bytes == summary.header_bytes + 4 * 9
    assert summary.bits_per_pixel == 8 * len(GOOD) / (2 * 256 * 448)


def test_damaged_and_optional_sections_are_listed() -> None:
    damaged = GOOD[: EXAMPLE.b2_offset - 1] + b"!" + GOOD[EXAMPLE.b2_offset :]
    summary = inspect(damaged)
    assert [section.is_intact for section in summary.sections] == [True, False, True, True]
    assert summary.damage is not None and summary.damage.startswith(f"section B1 at byte {EXAMPLE.b1_offset}: CRC-32")
    assert (summary.near, summary.far) == (0.5, 100.0)
    sections = inspect(write_stream(replace(example_stream(), detail=Detail(24, b"fine")))).sections
    assert [section.name for section in sections] == ["cameras", "B1", "B2", "detail", "metadata"]
    assert (sections[3].offset, sections[3].length, sections[3].is_intact) == (EXAMPLE.end, 5, True)
    damaged = GOOD[:60] + bytes([GOOD[60] ^ 1]) + GOOD[61:]
    summary = inspect(damaged)
    assert summary.damage is not None and summary.damage.startswith("section cameras at byte 48: CRC-32")
    assert (summary.near, summary.far) == (None, None)
    with pytest.raises(BitstreamError, match="the header needs 48"):
        inspect(GOOD[:47])


def test_a_cut_stream_is_described_as_far_as_it_goes() -> None:
    for length in range(48, len(GOOD)):
        summary = inspect(GOOD[:length])
        assert summary.damage is not None and f"the file ends after {length} bytes" in summary.damage
        whole = [section for section in list_sections(GOOD) if section.offset + 9 + section.length <= length]
        assert [section for section in summary.sections if section.is_intact] == whole
        assert (summary.near, summary.far) == ((0.5, 100.0) if length >= EXAMPLE.b1_offset else (None, None))
