"""The stages of a stream that a receiver decodes, and the checks that every receiver makes."""

from typing import Literal

from fecocodec.container.header import Header
from fecocodec.container.stream import IntactPart, read_intact, read_prefix, read_stream
from fecocodec.errors import BitstreamError, InputError

Stages = int | Literal["all", "intact"]
"""All stages, that many first ones, or those before the first damage."""


def read_stages(data: bytes, stages: Stages) -> IntactPart:
    """Parse the part of a stream that `stages` selects. Raises BitstreamError, or InputError for too few stages.

    Also raises InputError if `data` is not bytes, for example a path, or `stages` is another word.
    """
    if not isinstance(data, bytes | bytearray | memoryview):
        raise InputError(f"a stream is bytes, not {type(data).__name__}; read the file first (`Path.read_bytes`).")
    if not isinstance(stages, int) and stages not in ("all", "intact"):
        raise InputError(f'`stages` is {stages!r}; choose a number, "all" or "intact".')
    if isinstance(stages, int):
        return IntactPart(read_prefix(data, stages), damage=None)
    return read_intact(data) if stages == "intact" else IntactPart(read_stream(data), damage=None)


def check_pixels(header: Header, max_pixels: int) -> None:
    """Raise InputError if the views have more pixels than allowed."""
    if header.num_pixels > max_pixels:
        raise InputError(
            f"the views have {header.num_pixels} pixels in all, more than the {max_pixels} that are "
            "allowed; if you trust the file, raise `max_pixels`."
        )


def check_symbol_digest(header: Header, stage: int, found: bytes) -> None:
    """Raise BitstreamError if the digest of the decoded symbols of a stage is not that of the header."""
    stored = header.symbol_digests[stage - 1]
    if found != stored:
        raise BitstreamError(
            f"stage {stage}: the decoded symbols have digest {found.hex()}, the header says {stored.hex()}; "
            "the file is damaged or was made by a faulty encoder, copy or encode it again."
        )
