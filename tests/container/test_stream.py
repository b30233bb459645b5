"""Round trip of streams, prefixes, and what is intact of damaged ones."""

import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import given, settings

from fecocodec.container import (
    Detail,
    Stream,
    list_sections,
    read_intact,
    read_prefix,
    read_stream,
    with_metadata,
    write_stream,
)
from fecocodec.errors import BitstreamError, InputError
from tests.container.example_streams import example_stream, streams
from tests.container.faulty_streams import EXAMPLE, GOOD

# The run-time type checks use `random` to pick elements, also while a strategy builds a stream.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")


@settings(max_examples=40)
@given(streams())
def test_a_stream_is_read_back_as_written_and_a_prefix_ends_after_its_payload(stream: Stream) -> None:
    data = write_stream(stream)
    assert read_stream(data) == stream
    assert write_stream(read_stream(data)) == data
    ends = [section.offset + section.total_bytes for section in list_sections(data) if section.name in ("B1", "B2")]
    for number, end in enumerate(ends, start=1):
        expected = replace(stream, payloads=stream.payloads[:number], metadata=None, detail=None)
        assert all(read_prefix(part, number) == expected for part in (data, data[:end], data[:end] + b"anything"))
        with pytest.raises(BitstreamError):
            read_prefix(data[: end - 1], number)


def test_asking_for_a_stage_that_is_not_there_is_refused() -> None:
    one_stage = replace(example_stream().header, symbol_digests=(b"digest 1",))
    data = write_stream(Stream(one_stage, example_stream().cameras, (b"only",)))
    with pytest.raises(InputError, match="2 stages asked for, the stream has 1"):
        read_prefix(data, 2)


WITH_DETAIL = replace(example_stream(), detail=Detail(24, b"fine"))
DETAIL_END = EXAMPLE.end + 9 + len(b"\x18fine")
STAGES = replace(example_stream(), metadata=None)


def cut_at(data: bytes, length: int, intact: Stream) -> tuple[bytes, Stream, str]:
    return data[:length], intact, f"the file ends after {length} bytes"


@pytest.mark.parametrize(
    ("data", "intact", "damage"),
    [
        (GOOD, example_stream(), None),
        cut_at(GOOD, EXAMPLE.b2_offset, read_prefix(GOOD, 1)),
        cut_at(GOOD, EXAMPLE.b2_offset + 5, read_prefix(GOOD, 1)),
        cut_at(GOOD, EXAMPLE.end - 1, read_prefix(GOOD, 1)),
        (GOOD[: EXAMPLE.end - 1], read_prefix(GOOD, 1), "; the file is truncated, copy or download it again."),
        (GOOD[:-1] + b"!", STAGES, "section metadata at byte"),
        cut_at(write_stream(WITH_DETAIL), EXAMPLE.end, STAGES),
        cut_at(write_stream(WITH_DETAIL), EXAMPLE.end + 8, STAGES),
        cut_at(write_stream(WITH_DETAIL), DETAIL_END - 1, STAGES),
        (write_stream(WITH_DETAIL)[:-1], replace(WITH_DETAIL, metadata=None), "section metadata at byte"),
        (write_stream(WITH_DETAIL) + b"more", replace(WITH_DETAIL, metadata=None), "end at byte"),
        (GOOD[: EXAMPLE.b2_offset - 1], None, "section B1 at byte"),
    ],
)
def test_what_is_intact_is_read(data: bytes, intact: Stream | None, damage: str | None) -> None:
    """Its damage comes without the advice to decode it."""
    if intact is None:
        with pytest.raises(BitstreamError, match=damage):
            read_intact(data)
        return
    part = read_intact(data)
    assert part.stream == intact and (part.damage is None) == (damage is None)
    assert damage is None or (damage in part.damage and "`stages" not in part.damage)


def test_metadata_is_added_behind_detail() -> None:
    data = with_metadata(write_stream(replace(WITH_DETAIL, metadata=None)), {"name": "fox"})
    assert read_stream(data) == replace(WITH_DETAIL, metadata={"name": "fox"})


def test_damage_is_answered_with_the_way_out() -> None:
    damaged = write_stream(WITH_DETAIL).replace(b"fine", b"fins")
    with pytest.raises(
        BitstreamError, match=r'section detail .*CRC-32.*or decode what precedes it with `stages="intact"`\.$'
    ):
        read_stream(damaged)
    damage = read_intact(damaged).damage
    assert damage is not None and damage.startswith(f"section detail at byte {EXAMPLE.end}: CRC-32")
    assert damage.endswith("; the file is damaged, copy or encode it again.")
    with pytest.raises(BitstreamError, match=r"section B2 .*`stages=1`"):
        read_stream(GOOD[: EXAMPLE.end - 1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("'scene.fcs', 'all'", "a stream is bytes, not str; read the file first (`Path.read_bytes`)."),
        ("b'', 'first'", '`stages` is \'first\'; choose a number, "all" or "intact".'),
    ],
)
def test_arguments_of_a_wrong_kind_are_refused(arguments: str, message: str) -> None:
    """In a process of its own, because the run-time type checks of the tests would refuse the argument first."""
    code = f"from fecocodec.container import read_stages; read_stages({arguments})"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.stderr.splitlines()[-1] == f"fecocodec.errors.InputError: {message}"
