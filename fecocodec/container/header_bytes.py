"""The bytes of a header: signature, fixed fields, symbol digests, CRC-32 (FORMAT.md, section 4)."""

import struct
import zlib
from typing import NamedTuple

from fecocodec.container.header import (
    DIGEST_BYTES,
    FormatVersion,
    Header,
    check_header,
    check_stages,
    check_version,
)
from fecocodec.errors import BitstreamError

SIGNATURE = b"\x89FCS\r\n\x1a\n"
_OF_GAUSSIANS = "; of Gaussians, fecosplat view reads .ply and .spz files"
# What is given in place of a .fcs file, how it begins, and what reads it.
_OTHER_FORMATS = (
    ("a .ply file", b"ply", "; fecosplat view and fecosplat render read .ply files"),
    ("an .spz file", b"NGSP", "; fecosplat view reads .spz files"),
    ("an .spz file, or another one compressed with gzip", b"\x1f\x8b", "; fecosplat view reads .spz files"),
    ("a .glb file", b"glTF", _OF_GAUSSIANS),
    ("a .sog file, or another ZIP archive", b"PK\x03\x04", _OF_GAUSSIANS),
    ("a page (HTML)", b"<!DOCTYPE html", ""),
    ("a JPEG image", b"\xff\xd8\xff", "; it reads folders of photographs"),
)
SIGNATURE_BYTES = max(len(SIGNATURE), *(len(signature) for _, signature, _ in _OTHER_FORMATS))

_FIXED = struct.Struct("<8sBB8sBBHHHBB")
_CRC = struct.Struct("<I")


class ParsedHeader(NamedTuple):
    """A header with the number of sections that follow it, and its end: the byte offset of the first section."""

    header: Header
    num_sections: int
    end: int


def write_header(header: Header, num_sections: int) -> bytes:
    """Return the bytes of a header of `num_sections` sections. Raises BitstreamError for a field outside its limits."""
    check_header(header, num_sections)
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
        header.first_stage_excess,
    )
    content = fixed + b"".join(header.symbol_digests)
    return content + _CRC.pack(zlib.crc32(content))


def read_header(data: bytes) -> ParsedHeader:
    """Parse the header at the start of a stream. Raises BitstreamError for the first rule that it breaks."""
    check_signature(data)
    if len(data) >= len(SIGNATURE) + 2:
        check_version(FormatVersion(data[8], data[9]))
    _check_length(data, _FIXED.size)
    _, major, minor, model_id, views, stages, height, width, lambda_q, num_sections, excess = _FIXED.unpack_from(data)
    check_stages(stages)
    digests_end = _FIXED.size + DIGEST_BYTES * stages
    end = digests_end + _CRC.size
    _check_length(data, end)
    _check_crc(data, digests_end)
    digests = tuple(data[start : start + DIGEST_BYTES] for start in range(_FIXED.size, digests_end, DIGEST_BYTES))
    version = FormatVersion(major, minor)
    header = Header(model_id, views, height, width, lambda_q, digests, excess, version)
    check_header(header, num_sections)
    return ParsedHeader(header, num_sections, end)


def check_signature(data: bytes) -> None:
    """Raise BitstreamError if the first SIGNATURE_BYTES bytes of a file, or all of fewer, are those of another kind."""
    start = data[: len(SIGNATURE)]
    if start == SIGNATURE:
        return
    if SIGNATURE.startswith(start):
        _check_length(data, len(SIGNATURE))
    if b"FCS" in start:
        raise BitstreamError(
            "signature at byte 0: the file was changed as if it were text (line ends or high bits); "
            "copy it again in binary mode."
        )
    for name, signature, readers in _OTHER_FORMATS:
        if data.startswith(signature):
            raise BitstreamError(f"not a .fcs file: this is {name}; give a file written by fecosplat encode{readers}.")
    raise BitstreamError(
        f"not a .fcs file: its signature at byte 0 is {start.hex(' ')} instead of {SIGNATURE.hex(' ')}; "
        "give a file written by fecosplat encode."
    )


def _check_length(data: bytes, needed: int) -> None:
    if len(data) < needed:
        raise BitstreamError(
            f"header at byte 0: the file ends after {len(data)} bytes, the header needs {needed}; "
            "copy or download it again."
        )


def _check_crc(data: bytes, offset: int) -> None:
    (stored,) = _CRC.unpack_from(data, offset)
    found = zlib.crc32(data[:offset])
    if stored != found:
        raise BitstreamError(
            f"header at byte 0: CRC-32 is {found:#010x}, stored {stored:#010x}; "
            "the file is damaged, copy or encode it again."
        )
