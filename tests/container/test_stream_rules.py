"""Each broken rule of the format raises BitstreamError, whose message has location, cause and remedy."""

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fecocodec.container import inspect, read_intact, read_prefix, read_stream, write_stream
from fecocodec.errors import BitstreamError
from tests.container.example_streams import B1, B2, CAMERAS, METADATA, example_stream, sealed_section
from tests.container.faulty_streams import (
    EXAMPLE,
    FAULTS,
    GOOD,
    Fault,
)


def fault_name(fault: Fault) -> str:
    return f"{fault.rule}: {fault.cause}"


@pytest.mark.parametrize("fault", FAULTS, ids=fault_name)
def test_a_broken_rule_is_named_and_takes_little_memory(fault: Fault) -> None:
    tracemalloc.start()
    with pytest.raises(BitstreamError) as caught:
        read_stream(fault.data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000
    message = str(caught.value)
    assert message.startswith(fault.place)
    assert fault.cause in message
    assert "; " in message, "no remedy"
    assert "\n" not in message
    assert message.endswith(".")


@pytest.mark.parametrize("length", range(len(GOOD)))
def test_a_cut_stream_is_refused(length: int) -> None:
    with pytest.raises(BitstreamError):
        read_stream(GOOD[:length])


def test_no_flipped_bit_goes_unnoticed() -> None:
    for bit in range(8 * len(GOOD)):
        flipped = bytearray(GOOD)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(BitstreamError):
            read_stream(bytes(flipped))


@given(st.binary(max_size=300))
def test_arbitrary_bytes_raise_only_our_error(data: bytes) -> None:
    with pytest.raises(BitstreamError):
        read_stream(data)


@given(st.data())
def test_hostile_payloads_with_valid_crcs_raise_only_our_error(data: st.DataObject) -> None:
    """Section contents are random or mutated; the CRCs are valid."""
    kind, original = data.draw(st.sampled_from([(CAMERAS, EXAMPLE.cameras[9:]), (METADATA, EXAMPLE.metadata[9:])]))
    payload = bytearray(original)
    for position in data.draw(st.lists(st.integers(0, len(payload) - 1), max_size=4)):
        payload[position] = data.draw(st.integers(0, 255))
    sections = {CAMERAS: EXAMPLE.cameras, B1: EXAMPLE.b1, B2: EXAMPLE.b2, kind: sealed_section(kind, bytes(payload))}
    hostile = EXAMPLE.stream_of(*(sections[kind] for kind in sorted(sections, key=lambda kind: kind & 0x7F)))
    for read in (read_stream, read_intact, inspect, lambda stream: read_prefix(stream, 1)):
        try:
            read(hostile)
        except BitstreamError as error:
            assert ";" in str(error)


def test_the_example_itself_is_good() -> None:
    """Otherwise the tests above could pass for the wrong reason."""
    assert read_stream(GOOD) == example_stream()
    assert read_stream(write_stream(read_stream(GOOD))) == example_stream()
