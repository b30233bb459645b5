"""The header of a `.fcs` stream: its fields, their allowed values, and their bytes (FORMAT.md, section 4)."""

import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

from fecocodec.container.lagrangian import LAMBDA_Q_MAX, dequantise_lambda
from fecocodec.errors import BitstreamError

SIGNATURE = b"\x89FCS\r\n\x1a\n"
MODEL_ID_BYTES = 8
DIGEST_BYTES = 8
MAX_VIEWS = 16
MAX_STAGES = 2
MAX_SECTIONS = 16
MIN_SIDE, MAX_SIDE = 16, 4096
PADDING = 32  # the networks see sides rounded up to a multiple of this
MAX_PADDED_PIXELS = 1 << 24  # over all views: sixteen of 1024x1024

_FIXED = struct.Struct("<8sBB8sBBHHHBB")
_CRC = struct.Struct("<I")
_DAMAGED = "the file is damaged, copy or encode it again"
_BAD_WRITER = "the program that wrote it is at fault, encode the scene again"


class FormatVersion(NamedTuple):
    """A reader refuses another major version and reads any minor version of its own."""

    major: int
    minor: int


CURRENT_VERSION = FormatVersion(1, 0)


@dataclass(frozen=True)
class Header:
    """What a reader must know before it reads a section.

    model_id: first 8 bytes of the SHA-256 of the receiver's weights. height, width: of every view, in pixels, before
    padding. lambda_q: see `quantise_lambda`. symbol_digests: 8 bytes for each stage, over its decoded symbols.
    """

    model_id: bytes
    num_views: int
    height: int
    width: int
    lambda_q: int
    symbol_digests: tuple[bytes, ...]
    version: FormatVersion = CURRENT_VERSION

    @property
    def num_stages(self) -> int:
        return len(self.symbol_digests)

    @property
    def lmbda(self) -> float:
        return dequantise_lambda(self.lambda_q)


class ParsedHeader(NamedTuple):
    """A header as read, with what only the reader of the sections needs: their number and where the first begins."""

    header: Header
    num_sections: int
    end: int


def header_bytes(header: Header, num_sections: int) -> bytes:
    """The bytes of a header in front of that many sections; raises BitstreamError for a field outside its limits."""
    _check_version(header.version)
    _check_stages(header.num_stages)
    check_limits(header, num_sections)
    fixed = _FIXED.pack(
        SIGNATURE,
        *header.version,
        header.model_id,
        header.num_views,
        header.num_stages,
        header.height,
        header.width,
        header.lambda_q,
        num_sections,
        0,
    )
    content = fixed + b"".join(header.symbol_digests)
    return content + _CRC.pack(zlib.crc32(content))


def read_header(data: bytes) -> ParsedHeader:
    """Read and check the header at the start of a stream; raises BitstreamError for each rule it breaks."""
    _check_signature(data)
    if len(data) > len(SIGNATURE) + 1:
        _check_version(FormatVersion(data[8], data[9]))
    _check_length(data, _FIXED.size)
    _, major, minor, model_id, views, stages, height, width, lambda_q, num_sections, reserved = _FIXED.unpack_from(data)
    _check_stages(stages)
    digests_end = _FIXED.size + DIGEST_BYTES * stages
    end = digests_end + _CRC.size
    _check_length(data, end)
    (stored,) = _CRC.unpack_from(data, digests_end)
    found = zlib.crc32(data[:digests_end])
    if stored != found:
        raise BitstreamError(f"header at byte 0: CRC-32 is {found:#010x}, stored {stored:#010x}; {_DAMAGED}")
    if reserved != 0:
        raise BitstreamError(f"header at byte 27: the reserved byte is {reserved}, it must be 0; {_BAD_WRITER}")
    digests = tuple(data[start : start + DIGEST_BYTES] for start in range(_FIXED.size, digests_end, DIGEST_BYTES))
    header = Header(model_id, views, height, width, lambda_q, digests, FormatVersion(major, minor))
    check_limits(header, num_sections)
    return ParsedHeader(header, num_sections, end)


def padded_pixels(num_views: int, height: int, width: int) -> int:
    """Pixels of all views after each side is rounded up to a multiple of 32: what the receiver's memory grows with."""
    return num_views * (-height % PADDING + height) * (-width % PADDING + width)


def check_limits(header: Header, num_sections: int) -> None:
    """Raise BitstreamError for the first field outside its limits."""
    for offset, name, value, lowest, highest in (
        (18, "number of views", header.num_views, 1, MAX_VIEWS),
        (20, "height", header.height, MIN_SIDE, MAX_SIDE),
        (22, "width", header.width, MIN_SIDE, MAX_SIDE),
        (24, "quantised lambda", header.lambda_q, 0, LAMBDA_Q_MAX),
        (26, "number of sections", num_sections, 1 + header.num_stages, MAX_SECTIONS),
    ):
        if not lowest <= value <= highest:
            raise BitstreamError(
                f"header at byte {offset}: the {name} is {value}, allowed are {lowest} to {highest}; {_BAD_WRITER}"
            )
    pixels = padded_pixels(header.num_views, header.height, header.width)
    if pixels > MAX_PADDED_PIXELS:
        raise BitstreamError(
            f"header at byte 18: the views have {pixels} pixels after padding, "
            f"at most {MAX_PADDED_PIXELS} are allowed; encode fewer or smaller views"
        )
    for field in (header.model_id, *header.symbol_digests):
        if len(field) != 8:
            raise BitstreamError(f"header: a model id or symbol digest has {len(field)} bytes, it must have 8")


def _check_signature(data: bytes) -> None:
    start = data[: len(SIGNATURE)]
    if start == SIGNATURE:
        return
    if SIGNATURE.startswith(start):
        _check_length(data, len(SIGNATURE))
    if start[1:4] == SIGNATURE[1:4] or b"FCS" in start:
        raise BitstreamError(
            "signature at byte 0: the file was changed as text (line ends or high bits); copy it again in binary mode"
        )
    raise BitstreamError(
        f"signature at byte 0: found {start.hex(' ')}, a .fcs file starts with {SIGNATURE.hex(' ')}; "
        "give a file written by fecosplat encode"
    )


def _check_version(version: FormatVersion) -> None:
    if version.major > CURRENT_VERSION.major:
        raise BitstreamError(
            f"header at byte 8: format version {version.major}.{version.minor} is newer than "
            f"{CURRENT_VERSION.major}.x, which this program reads; install a newer fecosplat"
        )
    if version.major < CURRENT_VERSION.major:
        raise BitstreamError(f"header at byte 8: there is no format version {version.major}; {_DAMAGED}")


def _check_stages(stages: int) -> None:
    if not 1 <= stages <= MAX_STAGES:
        raise BitstreamError(
            f"header at byte 19: the number of stages is {stages}, allowed are 1 to {MAX_STAGES}; {_DAMAGED}"
        )


def _check_length(data: bytes, needed: int) -> None:
    if len(data) < needed:
        raise BitstreamError(
            f"header at byte 0: the file ends after {len(data)} bytes, the header needs {needed}; "
            "copy or download it again"
        )
