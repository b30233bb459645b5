"""A whole `.fcs` stream: header, cameras, coverage, one payload per stage, metadata (FORMAT.md, section 3)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from fecocodec.container.camera_rules import check_cameras
from fecocodec.container.cameras import PackedCameras, pack_cameras, unpack_cameras
from fecocodec.container.coverage import pack_coverage, unpack_coverage
from fecocodec.container.header import MAX_SECTIONS, Header
from fecocodec.container.header_bytes import ParsedHeader, read_header, write_header
from fecocodec.container.metadata import Metadata, pack_metadata, unpack_metadata
from fecocodec.container.sections import (
    KNOWN_KINDS,
    MAX_PAYLOAD,
    STAGE_KINDS,
    WHAT_IS_INTACT,
    SectionHead,
    SectionKind,
    check_kind,
    read_payload,
    read_section_head,
    section_bytes,
    section_name,
)
from fecocodec.errors import BitstreamError, InputError

MAX_STREAM_BYTES = MAX_SECTIONS * MAX_PAYLOAD  # more than any stream has: cameras are far below their share

_BAD_WRITER = "the program that wrote it is at fault, encode the scene again."


@dataclass(frozen=True)
class Stream:
    """The fields of a stream.

    payloads: B1 and B2; fewer than `header.num_stages` after reading a prefix. metadata: None where there is none, and
    always after reading a prefix. coverage: one bit for each cell of 4x4 pixels of the views' coding grids, see
    `coverage_grid` and `pack_coverage`; Gaussians of cells with bit 0 are dropped. None: all cells are covered.
    """

    header: Header
    cameras: PackedCameras
    payloads: tuple[bytes, ...]
    metadata: Metadata | None = None
    coverage: bytes | None = None


@dataclass(frozen=True)
class IntactPart:
    """The stages of a stream that can be decoded, and what is wrong with the rest (None: nothing)."""

    stream: Stream
    damage: str | None


class _Section(NamedTuple):
    """A section whose CRC holds and whose kind is in its place. payload: empty where the kind is unknown."""

    head: SectionHead
    payload: bytes


def write_stream(stream: Stream) -> bytes:
    """The bytes of a stream; the same stream gives the same bytes. Raises BitstreamError for a field it cannot hold."""
    header, cameras = stream.header, stream.cameras
    if cameras.num_views != header.num_views:
        raise BitstreamError(f"header: {header.num_views} views, but {cameras.num_views} cameras; give one per view.")
    if len(stream.payloads) != header.num_stages:
        raise BitstreamError(
            f"header: {header.num_stages} stages, but {len(stream.payloads)} payloads; give one per stage."
        )
    check_cameras(cameras, "section cameras")
    sections = [section_bytes(SectionKind.CAMERAS, pack_cameras(cameras))]
    if stream.coverage is not None:
        sections.append(section_bytes(SectionKind.COVERAGE, pack_coverage(stream.coverage, header)))
    sections += [section_bytes(kind, payload) for kind, payload in zip(STAGE_KINDS, stream.payloads, strict=False)]
    if stream.metadata is not None:
        sections.append(section_bytes(SectionKind.METADATA, pack_metadata(stream.metadata)))
    return write_header(header, len(sections)) + b"".join(sections)


def read_stream(data: bytes) -> Stream:
    """Read a whole stream, checking every rule of the format; raises BitstreamError for the first one broken."""
    parsed = read_header(data)
    sections = list(_sections(data, parsed))
    end = sections[-1].head.end
    if end != len(data):
        raise BitstreamError(
            f"end at byte {end}: {len(data) - end} bytes follow the last section; the file is damaged or was "
            "joined with another, copy or encode it again."
        )
    stream = _assemble(parsed.header, sections, parsed.header.num_stages)
    metadata = next((section for section in sections if section.head.kind == SectionKind.METADATA), None)
    return replace(
        stream, metadata=unpack_metadata(metadata.payload, metadata.head.place) if metadata is not None else None
    )


def read_prefix(data: bytes, num_stages: int) -> Stream:
    """Read a stream to the end of the payload of that stage (1 or 2) and ignore what follows, damaged or missing.

    Raises BitstreamError for a rule broken before that point and InputError for a stage the stream does not have.
    """
    parsed = read_header(data)
    if not 1 <= num_stages <= parsed.header.num_stages:
        raise InputError(f"{num_stages} stages asked for, the stream has {parsed.header.num_stages}; ask for fewer.")
    sections = []
    for section in _sections(data, parsed):
        sections.append(section)
        if section.head.kind == STAGE_KINDS[num_stages - 1]:
            break
    return _assemble(parsed.header, sections, num_stages)


def read_packed_cameras(data: bytes) -> PackedCameras:
    """The cameras of a stream, whatever follows them; raises BitstreamError for a rule broken before their end."""
    parsed = read_header(data)
    sections = []
    for section in _sections(data, parsed):
        sections.append(section)
        if section.head.kind == SectionKind.CAMERAS:
            break
    return _assemble(parsed.header, sections, 0).cameras


def read_intact(data: bytes) -> IntactPart:
    """Read as many stages as are undamaged; raises BitstreamError where not even the first can be decoded."""
    try:
        return IntactPart(read_stream(data), None)
    except BitstreamError as error:
        damage = error
    for num_stages in range(read_header(data).header.num_stages, 0, -1):
        try:
            # The advice to do with less is for those who asked for everything.
            return IntactPart(read_prefix(data, num_stages), str(damage).replace(WHAT_IS_INTACT, ""))
        except BitstreamError:
            continue  # a shorter prefix may still be whole; `damage` says what is wrong
    raise damage


def _sections(data: bytes, parsed: ParsedHeader) -> Iterator[_Section]:
    """The sections in order, each checked as it is reached."""
    offset, previous = parsed.end, None
    for _ in range(parsed.num_sections):
        head = read_section_head(data, offset)
        payload = read_payload(data, head)
        check_kind(head, previous)
        if head.kind in STAGE_KINDS[parsed.header.num_stages :]:
            raise BitstreamError(
                f"{head.place}: the header announces {parsed.header.num_stages} stage, this is one more; {_BAD_WRITER}"
            )
        yield _Section(head, payload if head.kind in KNOWN_KINDS else b"")
        offset, previous = head.end, head


def _assemble(header: Header, sections: list[_Section], num_stages: int) -> Stream:
    """Return a stream of these sections, without metadata, which decoding does not need."""
    found = {section.head.kind: section for section in sections}
    stage_kinds = STAGE_KINDS[:num_stages]
    for kind in (SectionKind.CAMERAS, *stage_kinds):
        if kind not in found:
            raise BitstreamError(f"section {section_name(kind)}: it is missing; {_BAD_WRITER}")
    head, payload = found[SectionKind.CAMERAS]
    cameras = unpack_cameras(payload, header.num_views, head.place)
    check_cameras(cameras, head.place)
    coverage = found.get(SectionKind.COVERAGE)
    return Stream(
        header,
        cameras,
        payloads=tuple(found[kind].payload for kind in stage_kinds),
        coverage=unpack_coverage(coverage.payload, header, coverage.head.place) if coverage is not None else None,
    )
