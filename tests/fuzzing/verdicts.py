"""What the readers say of bytes that may be anything: decoded, or refused with an error of ours."""

from collections.abc import Callable
from typing import TypeVar

from fecocodec.container import Stream, inspect, read_intact, read_prefix, read_stream
from fecocodec.errors import BitstreamError, FecoError, InputError
from tests.vectors.symbols import decode_detail_symbols, decode_symbols
from tests.vectors.tiny_model import tiny_model_id

Given = TypeVar("Given", bytes, Stream)
# Above it decoding takes the time that a scene of such a size needs, which says nothing about hostile input.
MOST_PIXELS = 1 << 17


EVERY_VERDICT = ("refused by container", "refused by symbols", "decoded", "read")


def verdict(data: bytes) -> str:
    """One of `EVERY_VERDICT` (`read`: of another model, or large); any other error than ours comes through."""
    for read in (inspect, read_intact, lambda stream: read_prefix(stream, 1)):
        is_refused(read, data, (BitstreamError, InputError))
    if not is_whole(data):
        return "refused by container"
    stream = read_stream(data)
    if stream.header.model_id != tiny_model_id() or stream.header.num_pixels > MOST_PIXELS:
        return "read"
    is_decoded = not (is_refused(decode_symbols, stream) or is_refused(decode_detail_symbols, stream))
    return "decoded" if is_decoded else "refused by symbols"


def is_refused(
    read: Callable[[Given], object], given: Given, kinds: tuple[type[FecoError], ...] = (BitstreamError,)
) -> bool:
    """Whether a reader raises one of our errors, whose message is one sentence."""
    try:
        read(given)
    except kinds as error:
        assert str(error).endswith(".") and "\n" not in str(error)
        return True
    return False


def is_whole(data: bytes) -> bool:
    """Whether the container keeps every rule; its symbols may still be damaged."""
    return not is_refused(read_stream, data)
