"""The section detail: a step of quantisation, then entropy-coded symbols (FORMAT.md, section 8.4)."""

from dataclasses import dataclass

from fecocodec.errors import BAD_WRITER, BitstreamError

MAX_DETAIL_STEP = 63


@dataclass(frozen=True)
class Detail:
    """Content of the section.

    step: 0 to 63; a symbol of 1 has the value 2^(-step / 8). payload: the symbols (ENTROPY.md, section 7.2), may be
    empty.
    """

    step: int
    payload: bytes


def pack_detail(detail: Detail) -> bytes:
    """Return the payload of the section. Raises BitstreamError for a step outside its limits."""
    _check_step(detail.step, "section detail")
    return bytes([detail.step]) + detail.payload


def unpack_detail(payload: bytes, place: str) -> Detail:
    """Return the content of a section. Raises BitstreamError, which starts with `place`, if it is empty or the step is
    outside its limits.
    """
    if not payload:
        raise BitstreamError(f"{place}: it is empty, it must hold a step; {BAD_WRITER}")
    _check_step(payload[0], place)
    return Detail(payload[0], payload[1:])


def _check_step(step: int, place: str) -> None:
    if not 0 <= step <= MAX_DETAIL_STEP:
        raise BitstreamError(f"{place}: its step is {step}, allowed are 0 to {MAX_DETAIL_STEP}; {BAD_WRITER}")
