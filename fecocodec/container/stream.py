"""A whole `.fcs` stream: its header and its sections in their order (FORMAT.md, section 3)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from fecocodec.container.camera_validation import check_cameras
from fecocodec.container.cameras import PackedCameras, pack_cameras, unpack_cameras
from fecocodec.container.detail_section import Detail, pack_detail, unpack_detail
from fecocodec.container.header import MAX_SECTIONS, Header
from fecocodec.container.header_bytes import ParsedHeader, read_header, write_header
from fecocodec.container.metadata import Metadata, pack_metadata, unpack_metadata
from fecocodec.container.sections import (
    KNOWN_KINDS,
    MAX_PAYLOAD,
    STAGE_KINDS,
    SectionHead,
    SectionKind,
    check_kind,
    read_payload,
    read_section_head,
    section_bytes,
    section_name,
    without_fallback,
)
from fecocodec.container.view_grids import COVERAGE_CELLS, FADING_BLOCKS
from fecocodec.errors import BAD_WRITER, BitstreamError, InputError

MAX_STREAM_BYTES = MAX_SECTIONS * MAX_PAYLOAD  # no valid stream is longer


@dataclass(frozen=True)
class Stream:
    """The fields of a stream.

    payloads: B1 and B2; fewer than `header.num_stages` if only a prefix was read. metadata: None if the stream has
    none or only a prefix was read. coverage: one bit per cell of 4x4 pixels of the coding grids, see `ViewGrids`;
    Gaussians of cells with bit 0 are dropped. None if all cells are covered. fading: two bits per block of 16x16
    pixels of the coding grids, which reduce opacities, see `ViewGrids`; None if no block is faded. detail: corrections
    to the Gaussians of the last stage; None if the stream has none or only a prefix was read.
    """

    header: Header
    cameras: PackedCameras
    payloads: tuple[bytes, ...]
    metadata: Metadata | None = None
    coverage: bytes | None = None
    fading: bytes | None = None
    detail: Detail | None = None


@dataclass(frozen=True)
class IntactPart:
    """The decodable stages of a stream. damage: message about the first damage, None for an intact stream."""

    stream: Stream
    damage: str | None


class _Section(NamedTuple):
    """A section with a valid CRC-32 at a valid position in the stream. payload: empty if the kind is unknown."""

    head: SectionHead
    payload: bytes


def write_stream(stream: Stream) -> bytes:
    """Return the bytes of a stream. The result is deterministic. Raises BitstreamError for an invalid field."""
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
        sections.append(section_bytes(SectionKind.COVERAGE, COVERAGE_CELLS.pack(stream.coverage, header)))
    if stream.fading is not None:
        sections.append(section_bytes(SectionKind.FADING, FADING_BLOCKS.pack(stream.fading, header)))
    sections += [section_bytes(kind, payload) for kind, payload in zip(STAGE_KINDS, stream.payloads, strict=False)]
    if stream.detail is not None:
        sections.append(section_bytes(SectionKind.DETAIL, pack_detail(stream.detail)))
    if stream.metadata is not None:
        sections.append(section_bytes(SectionKind.METADATA, pack_metadata(stream.metadata)))
    return write_header(header, len(sections)) + b"".join(sections)


def read_stream(data: bytes) -> Stream:
    """Parse a whole stream and check every rule of the format. Raises BitstreamError for the first rule it breaks."""
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


def with_metadata(data: bytes, metadata: Metadata) -> bytes:
    """Return a valid stream with these entries added to its metadata; entries of the same name are replaced.

    Raises BitstreamError for an invalid stream or metadata that the section cannot hold.
    """
    stream = read_stream(data)
    return write_stream(replace(stream, metadata={**(stream.metadata or {}), **metadata}))


def read_prefix(data: bytes, num_stages: int) -> Stream:
    """Parse a stream up to the payload of stage `num_stages` (1 or 2); what follows may be damaged or missing.

    The result has neither detail nor metadata, which follow the last stage.

    Raises BitstreamError for a rule broken before that point and InputError if the stream has fewer stages.
    """
    parsed = read_header(data)
    if not 1 <= num_stages <= parsed.header.num_stages:
        raise InputError(f"{num_stages} stages asked for, the stream has {parsed.header.num_stages}; ask for fewer.")
    return _read_until(data, parsed, STAGE_KINDS[num_stages - 1], num_stages)


def read_packed_cameras(data: bytes) -> PackedCameras:
    """Return the cameras of a stream. Raises BitstreamError for a rule broken in or before the camera section."""
    return _read_until(data, read_header(data), SectionKind.CAMERAS, 0).cameras


def read_intact(data: bytes) -> IntactPart:
    """Parse as many stages as are intact, and detail if it is. Raises BitstreamError if not even stage 1 is.

    If anything is damaged, the result has no metadata.
    """
    try:
        return IntactPart(read_stream(data), None)
    except BitstreamError as error:
        damage = error
    parsed = read_header(data)
    count = parsed.header.num_stages
    ends = [(SectionKind.DETAIL, count), *((STAGE_KINDS[stage - 1], stage) for stage in range(count, 0, -1))]
    for end, num_stages in ends:
        try:
            # Omit the advice to decode what is intact, because that is being done here.
            return IntactPart(_read_until(data, parsed, end, num_stages), without_fallback(str(damage)))
        except BitstreamError:
            continue  # a shorter prefix may be intact; `damage` is reported in any case
    raise damage


def _read_until(data: bytes, parsed: ParsedHeader, end: SectionKind, num_stages: int) -> Stream:
    """Parse the sections up to the one of this kind, or all if there is none, without metadata.

    num_stages: among them. Raises BitstreamError for a rule broken before the end.
    """
    sections = []
    for section in _sections(data, parsed):
        sections.append(section)
        if section.head.kind == end:
            break
    return _assemble(parsed.header, sections, num_stages)


def _sections(data: bytes, parsed: ParsedHeader) -> Iterator[_Section]:
    """Yield the sections in order; each is checked before it is yielded."""
    offset, previous = parsed.end, None
    for _ in range(parsed.num_sections):
        head = read_section_head(data, offset)
        payload = read_payload(data, head)
        check_kind(head, previous)
        if head.kind in STAGE_KINDS[parsed.header.num_stages :]:
            raise BitstreamError(
                f"{head.place}: the header announces {parsed.header.num_stages} stage, this is one more; {BAD_WRITER}"
            )
        yield _Section(head, payload if head.kind in KNOWN_KINDS else b"")
        offset, previous = head.end, head


def _assemble(header: Header, sections: list[_Section], num_stages: int) -> Stream:
    """Return a stream of these sections, with `num_stages` payloads and without metadata."""
    found = {section.head.kind: section for section in sections}
    stage_kinds = STAGE_KINDS[:num_stages]
    for kind in (SectionKind.CAMERAS, *stage_kinds):
        if kind not in found:
            raise BitstreamError(f"section {section_name(kind)}: it is missing; {BAD_WRITER}")
    head, payload = found[SectionKind.CAMERAS]
    cameras = unpack_cameras(payload, header.num_views, head.place)
    check_cameras(cameras, head.place)
    coverage, fading = found.get(SectionKind.COVERAGE), found.get(SectionKind.FADING)
    detail = found.get(SectionKind.DETAIL)
    return Stream(
        header,
        cameras,
        payloads=tuple(found[kind].payload for kind in stage_kinds),
        coverage=COVERAGE_CELLS.unpack(coverage.payload, header, coverage.head.place) if coverage is not None else None,
        fading=FADING_BLOCKS.unpack(fading.payload, header, fading.head.place) if fading is not None else None,
        detail=unpack_detail(detail.payload, detail.head.place) if detail is not None else None,
    )
