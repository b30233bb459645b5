"""Each broken rule of the format raises BitstreamError, whose message has location, cause and remedy."""

import tracemalloc

import pytest

from fecocodec.container import read_stream
from fecocodec.errors import BitstreamError
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
