"""What the readers say of bytes that may be anything: decoded, or refused with an error of ours."""

from fecocodec.container import Stream, inspect, read_intact, read_prefix, read_stream
from fecocodec.errors import BitstreamError, FecoError, InputError
from tests.vectors.symbols import decode_detail_symbols, decode_symbols
from tests.vectors.tiny_model import tiny_model_id

# Above it decoding takes the time that a scene of such a size needs, which says nothing about hostile input.
MOST_PIXELS = 1 << 17


EVERY_VERDICT = ("refused by container", "refused by symbols", "decoded", "read")


def verdict(data: bytes) -> str:
    """One of `EVERY_VERDICT` (`read`: of another model, or large); any other error than ours comes through."""
    for read in (inspect, read_intact, lambda stream: read_prefix(stream, 1)):
        try:
            read(data)
        except (BitstreamError, InputError) as error:
            assert is_sentence(error)
    try:
        stream = read_stream(data)
    except BitstreamError as error:
        assert is_sentence(error)
        return "refused by container"
    if not decodes_quickly(stream):
        return "read"
    try:
        decode_symbols(stream)
        decode_detail_symbols(stream)
    except BitstreamError as error:
        assert is_sentence(error)
        return "refused by symbols"
    return "decoded"


def is_sentence(error: FecoError) -> bool:
    return str(error).endswith(".") and "\n" not in str(error)


def is_whole(data: bytes) -> bool:
    """Whether the container keeps every rule; its symbols may still be damaged."""
    try:
        read_stream(data)
    except BitstreamError:
        return False
    return True


def decodes_quickly(stream: Stream) -> bool:
    return stream.header.model_id == tiny_model_id() and stream.header.num_pixels <= MOST_PIXELS
