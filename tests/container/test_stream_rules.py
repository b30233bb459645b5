"""Each broken rule of the format raises BitstreamError, whose message has location, cause and remedy."""

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fecocodec.container import read_stream, write_stream
from fecocodec.errors import BitstreamError
from tests.container.example_streams import example_stream
from tests.container.faulty_streams import FAULTS, GOOD, Fault


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.rule}: {fault.cause}")
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


def test_no_cut_and_no_flipped_bit_goes_unnoticed() -> None:
    flipped = []
    for bit in range(8 * len(GOOD)):
        flipped.append(bytearray(GOOD))
        flipped[-1][bit // 8] ^= 1 << bit % 8
    for data in (*(GOOD[:length] for length in range(len(GOOD))), *map(bytes, flipped)):
        with pytest.raises(BitstreamError):
            read_stream(data)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_raise_only_our_error(data: bytes) -> None:
    with pytest.raises(BitstreamError):
        read_stream(data)


def test_the_example_itself_is_good() -> None:
    """Otherwise the tests above could pass for the wrong reason."""
    assert read_stream(GOOD) == example_stream()
    assert read_stream(write_stream(read_stream(GOOD))) == example_stream()
