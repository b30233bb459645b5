"""The metadata section: a JSON object, compressed with zstd. Decoding does not need it (FORMAT.md, section 8.3)."""

import json
import math
from typing import Any, NoReturn

import zstandard

from fecocodec.errors import BAD_WRITER, BitstreamError

MAX_JSON_BYTES = 1 << 16
MAX_JSON_DEPTH = 8  # nesting of objects and lists; far below the depth that exhausts the stack
MAX_WINDOW_BYTES = 1 << 23  # the window that RFC 8878, section 3.1.1.1.2, recommends every decoder to support

Metadata = dict[str, Any]


def pack_metadata(metadata: Metadata) -> bytes:
    """Return the payload of the metadata section.

    Raises BitstreamError if JSON cannot represent the metadata exactly or the text exceeds MAX_JSON_BYTES.
    """
    try:
        text = json.dumps(metadata, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        content = text.encode("utf-8")
    except (TypeError, ValueError, RecursionError) as error:
        raise BitstreamError(f"section metadata: it cannot be written as JSON ({error}); remove it.") from error
    if len(content) > MAX_JSON_BYTES:
        raise BitstreamError(
            f"section metadata: its JSON has {len(content)} bytes, at most {MAX_JSON_BYTES} are allowed; shorten it."
        )
    if _parse(content, "section metadata") != metadata:
        raise BitstreamError("section metadata: JSON cannot hold it exactly; use text keys, lists, numbers and text.")
    return zstandard.ZstdCompressor(level=19).compress(content)


def unpack_metadata(payload: bytes, place: str) -> Metadata:
    """Return the metadata of a payload. Raises BitstreamError, which begins with `place`, for an invalid payload."""
    try:
        frame = zstandard.get_frame_parameters(payload)
        if frame.content_size > MAX_JSON_BYTES:  # zstd reports an unstated size as 2^64 - 1
            raise BitstreamError(
                f"{place}: its zstd frame does not state a size of at most {MAX_JSON_BYTES} bytes; {BAD_WRITER}"
            )
        if frame.window_size > MAX_WINDOW_BYTES:
            raise BitstreamError(
                f"{place}: its zstd frame has a window of {frame.window_size} bytes, at most {MAX_WINDOW_BYTES} are "
                f"allowed; {BAD_WRITER}"
            )
        content = zstandard.ZstdDecompressor().decompress(payload, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise BitstreamError(f"{place}: no valid zstd frame ({error}); {BAD_WRITER}") from error
    return _parse(content, place)


def _parse(content: bytes, place: str) -> Metadata:
    try:
        value = json.loads(
            content.decode("utf-8"),
            parse_float=_finite_float,
            parse_int=_finite_int,
            parse_constant=_refuse_constant,
            object_pairs_hook=_object_of_pairs,
        )
        _check_depth(value, MAX_JSON_DEPTH)
        json.dumps(value, ensure_ascii=False).encode("utf-8")  # fails for an unpaired surrogate
    except (ValueError, RecursionError) as error:
        raise BitstreamError(f"{place}: no valid JSON ({error}); {BAD_WRITER}") from error
    if not isinstance(value, dict):
        raise BitstreamError(f"{place}: its JSON is not an object; {BAD_WRITER}")
    return value


def _finite_float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text if len(text) <= 20 else text[:20] + '...'} is too large")
    return value


def _finite_int(text: str) -> int:
    _finite_float(text)  # rejects integers beyond binary64, at least 309 digits long, before the slow int()
    return int(text)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _object_of_pairs(pairs: list[tuple[str, Any]]) -> Metadata:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a key appears twice")
    return fields


def _check_depth(value: object, levels: int) -> None:
    if isinstance(value, dict | list):
        if levels == 0:
            raise ValueError(f"it is nested more than {MAX_JSON_DEPTH} deep")
        for item in value.values() if isinstance(value, dict) else value:
            _check_depth(item, levels - 1)
