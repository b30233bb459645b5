"""Raw Deflate (RFC 1951) for sections: best compression when writing, bounded output when reading."""

import zlib

from fecocodec.errors import BAD_WRITER, BitstreamError

_WINDOW_BITS = -15  # raw Deflate without a checksum of its own, because a section has a CRC


def deflate(content: bytes) -> bytes:
    """Return the shortest of three Deflate encodings. They differ by a few bytes, depending on the content."""
    candidates = []
    for strategy in (zlib.Z_DEFAULT_STRATEGY, zlib.Z_HUFFMAN_ONLY, zlib.Z_FIXED):
        compressor = zlib.compressobj(9, zlib.DEFLATED, _WINDOW_BITS, 9, strategy)
        candidates.append(compressor.compress(content) + compressor.flush())
    return min(candidates, key=len)


def inflate(payload: bytes, max_size: int, place: str) -> bytes:
    """Return the inflated payload; no more than `max_size` + 1 bytes are ever inflated.

    Raises BitstreamError, whose message starts with `place`, unless the payload is exactly one Deflate stream of at
    most `max_size` bytes of content.
    """
    inflater = zlib.decompressobj(_WINDOW_BITS)
    try:
        content = inflater.decompress(payload, max_size + 1)
    except zlib.error as error:
        raise BitstreamError(f"{place}: no valid Deflate data ({error}); {BAD_WRITER}") from error
    if len(content) > max_size:
        raise BitstreamError(f"{place}: it inflates to more than the {max_size} bytes it may hold; {BAD_WRITER}")
    if not inflater.eof:
        raise BitstreamError(f"{place}: its Deflate data has no end; {BAD_WRITER}")
    if inflater.unused_data:
        raise BitstreamError(f"{place}: {len(inflater.unused_data)} bytes follow its Deflate data; {BAD_WRITER}")
    return content
