"""Sections of a `.fcs` stream: kind, length, CRC-32, payload, one after another (FORMAT.md, section 5)."""

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

from fecocodec.errors import BAD_WRITER, BitstreamError

CRITICAL = 0x80  # bit of a kind: a reader refuses an unknown kind with this bit and skips one without it
MAX_PAYLOAD = 1 << 26
# Appended to messages about a damaged section B2 or detail, because what precedes it is still decodable.
_INTACT = ', or decode what precedes it with `stages="intact"`'
_INTACT_OR_FIRST = f"{_INTACT} or `stages=1`"

_HEAD = struct.Struct("<BI")
_CRC = struct.Struct("<I")
SECTION_OVERHEAD = _HEAD.size + _CRC.size


class SectionKind(IntEnum):
    """Kinds of sections that this version knows, in the order of a stream: ascending, ignoring the critical bit."""

    CAMERAS = CRITICAL | 0x10
    COVERAGE = CRITICAL | 0x18
    FADING = CRITICAL | 0x1C
    STAGE_1 = CRITICAL | 0x20
    STAGE_2 = CRITICAL | 0x30
    DETAIL = CRITICAL | 0x38
    METADATA = 0x40


STAGE_KINDS = (SectionKind.STAGE_1, SectionKind.STAGE_2)
_NAMES: dict[int, str] = {
    SectionKind.CAMERAS: "cameras",
    SectionKind.COVERAGE: "coverage",
    SectionKind.FADING: "fading",
    SectionKind.STAGE_1: "B1",
    SectionKind.STAGE_2: "B2",
    SectionKind.DETAIL: "detail",
    SectionKind.METADATA: "metadata",
}
KNOWN_KINDS = frozenset(SectionKind)
_MAX_PAYLOADS: dict[int, int] = {
    SectionKind.CAMERAS: 1 << 11,
    SectionKind.COVERAGE: 1 << 18,
    SectionKind.FADING: 1 << 15,
    SectionKind.METADATA: 1 << 16,
}


@dataclass(frozen=True)
class SectionHead:
    """Head of a section, whose CRC-32 is not yet checked. offset: of its first byte. length: of the payload."""

    kind: int
    offset: int
    length: int
    crc32: int

    @property
    def name(self) -> str:
        return section_name(self.kind)

    @property
    def place(self) -> str:
        """Return the name and offset of this section, with which error messages start."""
        return f"section {self.name} at byte {self.offset}"

    @property
    def payload_offset(self) -> int:
        return self.offset + SECTION_OVERHEAD

    @property
    def end(self) -> int:
        return self.payload_offset + self.length


def section_name(kind: int) -> str:
    """Return the name of a kind, or its number in hexadecimal if it is unknown."""
    return _NAMES.get(kind, f"{kind:#04x}")


def section_bytes(kind: SectionKind, payload: bytes) -> bytes:
    """Return the bytes of a section. Raises BitstreamError if the payload exceeds the limit of its kind."""
    limit = _MAX_PAYLOADS.get(kind, MAX_PAYLOAD)
    if len(payload) > limit:
        raise BitstreamError(
            f"section {section_name(kind)}: it needs {len(payload)} bytes, at most {limit} are allowed; "
            "encode fewer or smaller views."
        )
    head = _HEAD.pack(kind, len(payload))
    return head + _CRC.pack(zlib.crc32(payload, zlib.crc32(head))) + payload


def read_section_head(data: bytes, offset: int) -> SectionHead:
    """Return the section head at a byte offset.

    Raises BitstreamError if the file ends inside the head or the length exceeds the limit of the kind.
    """
    if len(data) < offset + SECTION_OVERHEAD:
        raise BitstreamError(
            f"section at byte {offset}: the file ends after {len(data)} bytes, inside or before the head of a section "
            "that the header announces; copy or download it again."
        )
    kind, length = _HEAD.unpack_from(data, offset)
    (crc32,) = _CRC.unpack_from(data, offset + _HEAD.size)
    head = SectionHead(kind, offset, length, crc32)
    limit = _MAX_PAYLOADS.get(kind, MAX_PAYLOAD)
    if length > limit:
        raise BitstreamError(
            f"{head.place}: its length is {length}, at most {limit} bytes are allowed; "
            "the file is damaged, copy or encode it again."
        )
    return head


def read_payload(data: bytes, head: SectionHead) -> bytes:
    """Return the payload of a section. Raises BitstreamError if the file ends inside it or its CRC-32 differs."""
    if len(data) < head.end:
        raise BitstreamError(
            f"{head.place}: the file ends after {len(data)} bytes, but the section reaches to byte {head.end}; "
            f"the file is truncated, copy or download it again{_fallback(head)}."
        )
    payload = data[head.payload_offset : head.end]
    found = zlib.crc32(payload, zlib.crc32(data[head.offset : head.offset + _HEAD.size]))
    if found != head.crc32:
        raise BitstreamError(
            f"{head.place}: CRC-32 is {found:#010x}, stored {head.crc32:#010x}; "
            f"the file is damaged, copy or encode it again{_fallback(head)}."
        )
    return payload


def check_kind(head: SectionHead, previous: SectionHead | None) -> None:
    """Raise BitstreamError for an unknown critical kind, a wrong critical bit, or a section out of order.

    previous: head of the section before this one, None for the first.
    """
    if head.kind not in _NAMES:
        if head.kind ^ CRITICAL in _NAMES:
            raise BitstreamError(f"{head.place}: the critical bit of this kind is wrong; {BAD_WRITER}")
        if head.kind & CRITICAL:
            raise BitstreamError(
                f"{head.place}: this kind is unknown and marked as needed for decoding; install a newer fecosplat."
            )
    if previous is None or head.kind & ~CRITICAL > previous.kind & ~CRITICAL:
        return
    problem = "appears twice" if head.kind == previous.kind else f"must stand before section {previous.name}"
    raise BitstreamError(f"{head.place}: it {problem}; {BAD_WRITER}")


def without_fallback(message: str) -> str:
    """Return a message about damage without the advice to decode what precedes it."""
    return message.replace(_INTACT_OR_FIRST, "").replace(_INTACT, "")


def _fallback(head: SectionHead) -> str:
    if head.kind == SectionKind.STAGE_2:
        return _INTACT_OR_FIRST
    return _INTACT if head.kind == SectionKind.DETAIL else ""
