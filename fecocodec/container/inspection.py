"""A description of a stream, damaged or not, for people: what it holds and where its bytes go."""

from dataclasses import dataclass

from fecocodec.container.cameras import PackedCameras
from fecocodec.container.coverage import coverage_grid
from fecocodec.container.header import Header
from fecocodec.container.header_bytes import read_header
from fecocodec.container.metadata import Metadata
from fecocodec.container.sections import SECTION_OVERHEAD, read_payload, read_section_head
from fecocodec.container.stream import Stream, read_packed_cameras, read_stream
from fecocodec.errors import BitstreamError


@dataclass(frozen=True)
class SectionSummary:
    """One section of a stream. offset: of its first byte. length: of its payload. is_intact: whether its CRC holds."""

    name: str
    offset: int
    length: int
    is_intact: bool

    @property
    def total_bytes(self) -> int:
        """With its head and CRC: what it adds to the file."""
        return self.length + SECTION_OVERHEAD


@dataclass(frozen=True)
class StreamSummary:
    """What can be told of a stream. Sizes are in bytes.

    header_bytes: header alone. overhead_bytes: header and the heads of all sections found. bits_per_pixel: of all
    views. damage: None for a stream that keeps every rule, else the sentence that says which rule it breaks.
    covered: share of the cells that the coverage section marks as covered, in [0, 1].
    near, far, covered and metadata are None where damage hides them (the latter two also where there is no such
    section).
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
    """Describe a stream; raises BitstreamError only where the header itself cannot be read."""
    parsed = read_header(data)
    header = parsed.header
    sections = list_sections(data)
    try:
        stream, damage = read_stream(data), None
    except BitstreamError as error:
        stream, damage = None, str(error)
    cameras = stream.cameras if stream else _intact_cameras(data)
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
    """The sections of a stream as far as they can be told apart, also behind a damaged payload.

    Raises BitstreamError only where the header itself cannot be read.
    """
    parsed = read_header(data)
    offset = parsed.end
    sections = []
    for _ in range(parsed.num_sections):
        try:
            head = read_section_head(data, offset)
        except BitstreamError:
            break  # the file ends here or the length is garbage: nothing behind it can be found
        sections.append(SectionSummary(head.name, offset, head.length, _is_intact(data, offset)))
        offset = head.end
    return tuple(sections)


def _covered(stream: Stream) -> float | None:
    if stream.coverage is None:
        return None
    views, rows, columns = coverage_grid(stream.header)
    return int.from_bytes(stream.coverage, "big").bit_count() / (views * rows * columns)


def _intact_cameras(data: bytes) -> PackedCameras | None:
    try:
        return read_packed_cameras(data)
    except BitstreamError:
        return None


def _is_intact(data: bytes, offset: int) -> bool:
    try:
        read_payload(data, read_section_head(data, offset))
    except BitstreamError:
        return False
    return True
