"""The stages of a stream that a receiver decodes, and the checks that every receiver makes."""

from collections.abc import Callable
from typing import Literal, TypeVar

from fecocodec.container.detail_section import Detail
from fecocodec.container.header import Header
from fecocodec.container.stream import IntactPart, Stream, read_intact, read_prefix, read_stream
from fecocodec.errors import BitstreamError, InputError
from fecocodec.progress import OnProgress

State = TypeVar("State")
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


def decode_stages(
    stream: Stream,
    stages: Stages,
    advance: Callable[[int, bytes, State | None], State],
    with_detail: Callable[[Detail, State], State],
    on_progress: OnProgress,
) -> tuple[State, int, str | None]:
    """Return the last state, the number of its stage, and the message about damage that "intact" tolerates.

    stream, stages: as for `read_stages`. advance: (stage, payload, state before it, if any) -> state. with_detail:
    (detail, state) -> state. Raises BitstreamError as these do.
    """
    state, number, damage = None, 0, None
    try:
        for stage, payload in enumerate(stream.payloads, start=1):
            on_progress(f"decoding stage {stage}", 0.4 * (stage - 1))
            state, number = advance(stage, payload, state), stage
        if stream.detail is not None and state is not None and number == stream.header.num_stages:
            state = with_detail(stream.detail, state)
    except BitstreamError as error:
        if state is None or stages != "intact":
            raise
        damage = str(error)
    assert state is not None  # a stream has at least one stage
    return state, number, damage


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
