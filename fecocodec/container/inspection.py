"""Summary of a stream, intact or damaged: its fields, its sections and their sizes."""

from contextlib import suppress
from dataclasses import dataclass

from fecocodec.container.header import Header
from fecocodec.container.header_bytes import read_header
from fecocodec.container.metadata import Metadata
from fecocodec.container.sections import SECTION_OVERHEAD, read_payload, read_section_head
from fecocodec.container.stream import Stream, read_packed_cameras, read_stream
from fecocodec.container.view_grids import COVERAGE_CELLS
from fecocodec.errors import BitstreamError


@dataclass(frozen=True)
class SectionSummary:
    """A section of a stream. offset: of its first byte. length: of its payload. is_intact: whether its CRC-32 fits."""

    name: str
    offset: int
    length: int
    is_intact: bool

    @property
    def total_bytes(self) -> int:
        """Return the size of the section in bytes, including its head and CRC."""
        return self.length + SECTION_OVERHEAD


@dataclass(frozen=True)
class StreamSummary:
    """Summary of a stream. Sizes are in bytes.

    header_bytes: of the header alone. overhead_bytes: of the header and the heads of all sections. bits_per_pixel:
    mean over the pixels of all views. near, far: depth bounds in scene units. covered: share of the cells that the
    coverage section marks as covered, in [0, 1]. damage: message of the first rule that the stream breaks, None for a
    valid stream. near, far, covered and metadata are None if damage makes them unreadable; covered and metadata are
    also None if the stream has no such section.
    """

    header: Header
    total_bytes: int
    header_bytes: int
    overhead_bytes: int
    bits_per_pixel: float
    sections: tuple[SectionSummary, ...]
    near: float | None
    far: float | None
    covered: float | None
    metadata: Metadata | None
    damage: str | None


def inspect(data: bytes) -> StreamSummary:
    """Return the summary of a stream. Raises BitstreamError only if the header itself cannot be read."""
    parsed = read_header(data)
    header = parsed.header
    sections = list_sections(data)
    try:
        stream, damage = read_stream(data), None
    except BitstreamError as error:
        stream, damage = None, str(error)
    cameras = stream.cameras if stream else None
    if stream is None:
        with suppress(BitstreamError):
            cameras = read_packed_cameras(data)
    return StreamSummary(
        header=header,
        total_bytes=len(data),
        header_bytes=parsed.end,
        overhead_bytes=parsed.end + SECTION_OVERHEAD * len(sections),
        bits_per_pixel=8 * len(data) / (header.num_views * header.height * header.width),
        sections=sections,
        near=cameras.near if cameras else None,
        far=cameras.far if cameras else None,
        covered=_covered(stream) if stream else None,
        metadata=stream.metadata if stream else None,
        damage=damage,
    )


def list_sections(data: bytes) -> tuple[SectionSummary, ...]:
    """Return the sections of a stream up to the first unreadable section head; damaged payloads are passed over.

    Raises BitstreamError only if the header itself cannot be read.
    """
    parsed = read_header(data)
    offset = parsed.end
    sections = []
    for _ in range(parsed.num_sections):
        try:
            head = read_section_head(data, offset)
        except BitstreamError:
            break  # the file ends here or the length is invalid, so later sections cannot be located
        is_intact = False
        with suppress(BitstreamError):
            read_payload(data, head)
            is_intact = True
        sections.append(SectionSummary(head.name, offset, head.length, is_intact))
        offset = head.end
    return tuple(sections)


def _covered(stream: Stream) -> float | None:
    if stream.coverage is None:
        return None
    views, rows, columns = COVERAGE_CELLS.shape(stream.header)
    return int.from_bytes(stream.coverage, "big").bit_count() / (views * rows * columns)
