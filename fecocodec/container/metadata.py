"""The metadata section: a JSON object, compressed with zstd, that decoding does not need (FORMAT.md, section 8.2)."""

import json
import math
from typing import Any, NoReturn

import zstandard

from fecocodec.errors import BitstreamError

MAX_JSON_BYTES = 1 << 16
MAX_JSON_DEPTH = 8  # of objects and lists in one another: far below what exhausts a stack
MAX_WINDOW_BYTES = 1 << 23  # what RFC 8878, section 3.1.1.1.2, asks every decoder to support

Metadata = dict[str, Any]
_BAD_WRITER = "the program that wrote it is at fault, encode the scene again."


def pack_metadata(metadata: Metadata) -> bytes:
    """The payload of the metadata section; raises BitstreamError for what JSON cannot hold, or too much."""
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
    """Read the payload of the metadata section; raises BitstreamError, naming `place`, for each rule it breaks."""
    try:
        frame = zstandard.get_frame_parameters(payload)
        if frame.content_size > MAX_JSON_BYTES:  # also where none is stated, which zstd reports as 2^64 - 1
            raise BitstreamError(
                f"{place}: its zstd frame does not state a size of at most {MAX_JSON_BYTES} bytes; {_BAD_WRITER}"
            )
        if frame.window_size > MAX_WINDOW_BYTES:
            raise BitstreamError(
                f"{place}: its zstd frame has a window of {frame.window_size} bytes, at most {MAX_WINDOW_BYTES} are "
                f"allowed; {_BAD_WRITER}"
            )
        content = zstandard.ZstdDecompressor().decompress(payload, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise BitstreamError(f"{place}: no valid zstd frame ({error}); {_BAD_WRITER}") from error
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
        json.dumps(value, ensure_ascii=False).encode("utf-8")  # fails for half a surrogate pair, which no text can show
    except (ValueError, RecursionError) as error:
        raise BitstreamError(f"{place}: no valid JSON ({error}); {_BAD_WRITER}") from error
    if not isinstance(value, dict):
        raise BitstreamError(f"{place}: its JSON is not an object; {_BAD_WRITER}")
    return value


def _finite_float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text if len(text) <= 20 else text[:20] + '...'} is too large")
    return value


def _finite_int(text: str) -> int:
    _finite_float(text)  # what a binary64 cannot hold has at least 309 digits; up to there int() is quick
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
