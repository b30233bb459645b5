"""Streams that break each rule of FORMAT.md, section 12, with the expected parts of the error message."""

import zlib
from dataclasses import dataclass, replace

import zstandard

from fecocodec.container import COVERAGE_CELLS, FADING_BLOCKS, PackedCameras, Stream, write_stream
from fecocodec.container.cameras import pack_cameras
from fecocodec.container.metadata import pack_metadata
from fecocodec.container.view_grids import ViewGrids
from tests.container.example_streams import (
    B1,
    B2,
    CAMERAS,
    COVERAGE,
    DETAIL,
    FADING,
    METADATA,
    TURNED,
    example_stream,
    grid_bytes,
    pose,
    sealed_header,
    sealed_section,
)


@dataclass(frozen=True)
class Fault:
    """A stream that breaks one rule. rule: first column of the table. place, cause: parts of the message."""

    rule: str
    data: bytes
    place: str
    cause: str


class Parts:
    """A valid stream of two views, two stages and metadata, and its parts, from which faulty streams are built.

    end: of section B2.
    """

    def __init__(self, stream: Stream) -> None:
        self.stream, self.good = stream, write_stream(stream)
        self.cameras = sealed_section(CAMERAS, pack_cameras(stream.cameras))
        self.b1, self.b2 = (
            sealed_section(kind, payload) for kind, payload in zip((B1, B2), stream.payloads, strict=True)
        )
        self.metadata = sealed_section(METADATA, pack_metadata(stream.metadata or {}))
        self.b1_offset = 48 + len(self.cameras)
        self.b2_offset = self.b1_offset + len(self.b1)
        self.end = self.b2_offset + len(self.b2)

    def header(self, **fields: int) -> bytes:
        return sealed_header(self.stream.header, **fields)

    def stream_of(self, *sections: bytes, stages: int = 2) -> bytes:
        return self.header(sections=len(sections), stages=stages) + b"".join(sections)

    def with_section(self, kind: int, payload: bytes) -> bytes:
        """Return cameras, B1 and B2 with another section, or one of these changed."""
        sections = {CAMERAS: self.cameras, B1: self.b1, B2: self.b2, kind: sealed_section(kind, payload)}
        return self.stream_of(*(sections[known] for known in sorted(sections, key=lambda known: known & 0x7F)))


def signature_faults(parts: Parts) -> list[Fault]:
    text_mode = "the signature was not changed by text mode"
    faults = [
        (text_mode, parts.good.replace(b"\r\n", b"\n"), "changed as if it were text"),
        (text_mode, parts.good.replace(b"\n", b"\r\n"), "changed as if it were text"),
        (text_mode, b"\x09" + parts.good[1:], "changed as if it were text"),
    ]
    png = Fault(
        "the stream starts with the signature",
        b"\x89PNG\r\n\x1a\n" + parts.good[8:],
        "not a .fcs file: its signature at byte 0 ",
        "is 89 50 4e 47",
    )
    return [png, *(Fault(rule, data, "signature at byte 0", cause) for rule, data, cause in faults)]


def header_faults(parts: Parts) -> list[Fault]:
    cut = "the whole header is there"
    faults = [
        (cut, b"", 0, "the file ends after 0 bytes"),
        (cut, parts.good[:20], 0, "the file ends after 20 bytes, the header needs 28"),
        (cut, parts.good[:47], 0, "the file ends after 47 bytes, the header needs 48"),
        ("major version is not above 2", parts.header(major=3), 8, "version 3.0 is newer than 2.x"),
        ("major version is not below 2", parts.header(major=1), 8, "format version 1.0 was never released"),
        ("number of stages", parts.header(stages=0), 19, "the number of stages is 0"),
        ("number of stages", parts.header(stages=3), 19, "the number of stages is 3"),
        ("header CRC-32", parts.good[:10] + b"M" + parts.good[11:], 0, "CRC-32 is 0x"),
        ("number of views", parts.header(views=0), 18, "the number of views is 0"),
        ("number of views", parts.header(views=17), 18, "the number of views is 17"),
        ("height", parts.header(height=63), 20, "the height is 63, allowed are 64 to 1024"),
        ("width", parts.header(width=1025), 22, "the width is 1025, allowed are 64 to 1024"),
        ("lambda_q", parts.header(lambda_q=1769), 24, "the quantised lambda is 1769, allowed are 0 to 1768"),
        ("number of sections", parts.header(sections=2), 26, "the number of sections is 2, allowed are 3 to 16"),
        ("number of sections", parts.header(sections=17), 26, "the number of sections is 17, allowed are 3 to 16"),
        ("excess of stage 1", parts.header(stages=1, sections=2, excess=1), 27, "is 1, allowed are 0 to 0"),
    ]
    return [Fault(rule, data, f"header at byte {offset}: ", cause) for rule, data, offset, cause in faults]


def cut_and_changed_section_faults(parts: Parts) -> list[Fault]:
    good, b1, b2, end = parts.good, parts.b1_offset, parts.b2_offset, parts.end
    last = end - 1
    cut_payload = f"after {last} bytes, but the section reaches to byte {end}"
    too_long = good[:49] + (2049).to_bytes(4, "little") + good[53:]
    fading_too_long = good[:b1] + bytes([FADING]) + (32769).to_bytes(4, "little") + good[b1 + 5 :]
    changed_kind = good[:b1] + b"\xa1" + good[b1 + 1 :]
    faults = [
        ("every section head is there", good[:end], "", end, "inside or before the head"),
        ("every section head is there", good[: b1 + 8], "", b1, "inside or before the head"),
        ("length within the limit", too_long, "cameras ", 48, "its length is 2049, at most 2048"),
        ("length within the limit", fading_too_long, "fading ", b1, "its length is 32769, at most 32768"),
        ("the whole payload is there", good[:last], "B2 ", b2, cut_payload),
        ("section CRC-32", changed_kind, "0xa1 ", b1, "CRC-32 is 0x"),
        ("section CRC-32", good[: b2 - 1] + bytes([good[b2 - 1] ^ 1]) + good[b2:], "B1 ", b1, "CRC-32 is 0x"),
        ("section CRC-32", good[:last] + bytes([good[last] ^ 1]) + good[end:], "B2 ", b2, "CRC-32 is 0x"),
    ]
    return [Fault(rule, data, f"section {name}at byte {at}: ", cause) for rule, data, name, at, cause in faults] + [
        Fault("nothing follows", good + b"\0", f"end at byte {len(good)}: ", "1 bytes follow the last section")
    ]


def section_order_faults(parts: Parts) -> list[Fault]:
    cameras, b1, b2, metadata = parts.cameras, parts.b1, parts.b2, parts.metadata
    missing = "cameras, B1, B2 are there"
    wrong_bit = parts.stream_of(cameras, sealed_section(0x20, parts.stream.payloads[0]), b2)
    no_critical_bit = parts.stream_of(cameras, sealed_section(FADING & 0x7F, b"levels"), b1, b2)
    late_fading = parts.stream_of(cameras, b1, sealed_section(FADING, b"levels"), b2)
    unknown = parts.stream_of(cameras, sealed_section(0x95, b"needed"), b1, b2)
    one_stage = parts.stream_of(cameras, b1, b2, stages=1)
    critical, is_wrong = "critical bit of a known kind", "the critical bit of this kind is wrong"
    faults = [
        (critical, wrong_bit, f"0x20 at byte {parts.b1_offset}", is_wrong),
        (critical, no_critical_bit, f"0x1c at byte {parts.b1_offset}", is_wrong),
        ("unknown kinds are not critical", unknown, f"0x95 at byte {parts.b1_offset}", "unknown and marked as needed"),
        ("no kind twice", parts.stream_of(cameras, b1, b1, b2), f"B1 at byte {parts.b2_offset}", "it appears twice"),
        ("ascending order", parts.stream_of(b1, cameras, b2), f"cameras at byte {48 + len(b1)}", "before section B1"),
        ("ascending order", late_fading, f"fading at byte {parts.b2_offset}", "before section B1"),
        ("B2 only with two stages", one_stage, f"B2 at byte {parts.b2_offset - 8}", "the header announces 1 stage"),
        (missing, parts.stream_of(b1, b2, metadata), "cameras", "it is missing"),
        (missing, parts.stream_of(cameras, b2, metadata), "B1", "it is missing"),
        (missing, parts.stream_of(cameras, b1, metadata), "B2", "it is missing"),
    ]
    return [Fault(rule, data, f"section {place}: ", cause) for rule, data, place, cause in faults]


def deflated(content: bytes) -> bytes:
    compressor = zlib.compressobj(9, zlib.DEFLATED, -15)
    return compressor.compress(content) + compressor.flush()


def camera_payload_faults(parts: Parts) -> list[Fault]:
    payload = pack_cameras(parts.stream.cameras)
    content = zlib.decompress(payload, -15)
    faults = {
        "Deflate data valid": (b"\xff" * 40, "no valid Deflate data"),
        "Deflate data not too long": (deflated(bytes(500_000)), "inflates to more than the 137 bytes"),
        "Deflate data has an end": (payload[:-1], "its Deflate data has no end"),
        "nothing after the Deflate data": (payload + b"\0", "1 bytes follow its Deflate data"),
        "K is 1 or N": (deflated(b"\3" + content[1:]), "it holds 3 sets of intrinsics"),
        "content size": (deflated(content[:-1]), f"to {len(content) - 1} bytes, 2 views need {len(content)}"),
    }
    return [
        Fault(rule, parts.with_section(CAMERAS, bad), "section cameras at byte 48", cause)
        for rule, (bad, cause) in faults.items()
    ]


def camera_value_faults(parts: Parts) -> list[Fault]:
    good = parts.stream.cameras
    nan, infinity = float("nan"), float("inf")

    def with_pose(turned: tuple[float, ...]) -> PackedCameras:
        return replace(good, extrinsics=(good.extrinsics[0], turned))

    def with_lens(*lens: float) -> PackedCameras:
        return replace(good, intrinsics=(good.intrinsics[0], lens))

    here, second = (0.0, 0.0, 0.0), "camera 2 of 2"
    scaled = tuple(1.001 * value for value in TURNED)
    mirrored = (-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    faults = [
        ("finite near, far", replace(good, near=nan), "", "near is nan, it must be a finite float32 value"),
        ("finite near, far", replace(good, far=infinity), "", "far is inf, it must be a finite float32 value"),
        ("near within its bounds", replace(good, near=0.0), "", "near is 0.0, it must be 2^-40 to 2^40"),
        ("near within its bounds", replace(good, near=-1.0), "", "near is -1.0, it must be 2^-40 to 2^40"),
        ("near within its bounds", replace(good, near=2.0**41, far=2.0**42), "", "it must be 2^-40 to 2^40"),
        ("far / near within its bounds", replace(good, near=100.0), "", "far must be 1.002 to 16384 times near"),
        ("far / near within its bounds", replace(good, far=8193.0), "", "far must be 1.002 to 16384 times near"),
        ("finite camera values", with_pose(pose(TURNED, (0.0, nan, 0.0))), second, "ty is nan"),
        ("finite camera values", with_pose(pose((infinity, *TURNED[1:]), here)), second, "r00 is inf"),
        ("finite camera values", with_lens(1.0, 1.0, nan, 0.5), second, "cx is nan"),
        ("rotation orthonormal", with_pose(pose(scaled, here)), second, "its rotation is not orthonormal"),
        ("rotation orthonormal", with_pose(pose((0.0,) * 9, here)), second, "its rotation is not orthonormal"),
        (
            "rotation orthonormal",
            with_pose(pose((1e30,) * 9, here)),
            second,
            "its rotation is not orthonormal",
        ),
        ("not mirrored", with_pose(pose(mirrored, here)), second, "its pose is mirrored"),
        ("centre not too far", with_pose(pose(TURNED, (2.0**61, 0.0, 0.0))), second, "more than 2^60"),
        (
            "centre not too far from the mean",
            with_pose(pose(TURNED, (0.0, 2.0**14 + 1.0, 0.0))),
            "camera 1 of 2",
            "more than 16384 near from the mean position",
        ),
        ("focal lengths", with_lens(0.0, 1.0, 0.5, 0.5), second, "focal length fx is 0.0"),
        ("focal lengths", with_lens(1.0, -1.0, 0.5, 0.5), second, "focal length fy is -1.0"),
        ("principal point", with_lens(1.0, 1.0, 0.5, 257.0), second, "principal point cy is 257.0"),
    ]
    return [
        Fault(rule, parts.with_section(CAMERAS, pack_cameras(cameras)), f"section cameras at byte 48: {camera}", cause)
        for rule, cameras, camera, cause in faults
    ]


def grid_faults(parts: Parts, kind: int, grids: ViewGrids) -> list[Fault]:
    """Return faults of coverage or fading."""
    size = grid_bytes(grids, parts.stream.header)
    whole = deflated(bytes(size))
    faults = [
        ("Deflate data valid", b"\xff" * 40, "no valid Deflate data"),
        ("Deflate data not too long", deflated(bytes(20_000_000)), f"inflates to more than the {size} bytes"),
        ("Deflate data has an end", whole[:-1], "its Deflate data has no end"),
        ("nothing after the Deflate data", whole + b"\0", "1 bytes follow its Deflate data"),
        (
            f"{grids.squares} of {grids.name} have their size",
            deflated(bytes(size - 1)),
            f"take {size - 1} bytes, the views need {size}",
        ),
    ]
    place = f"section {grids.name} at byte {parts.b1_offset}"
    return [Fault(rule, parts.with_section(kind, data), place, cause) for rule, data, cause in faults]


def detail_faults(parts: Parts) -> list[Fault]:
    cameras, b1, b2, metadata, end = parts.cameras, parts.b1, parts.b2, parts.metadata, parts.end
    detail = sealed_section(DETAIL, b"\x18" + bytes(range(1, 9)))
    with_detail = parts.stream_of(cameras, b1, b2, detail, metadata)
    last = end + len(detail) - 1
    too_long = with_detail[: end + 1] + (2**26 + 1).to_bytes(4, "little") + with_detail[end + 5 :]
    cut_payload = f"after {last} bytes, but the section reaches to byte {last + 1}"
    changed = with_detail[:last] + b"!" + with_detail[last + 1 :]
    not_critical = parts.stream_of(cameras, b1, b2, sealed_section(DETAIL & 0x7F, b"\x18"))
    early = parts.stream_of(cameras, b1, detail, b2)
    late = parts.stream_of(cameras, b1, b2, metadata, detail)
    empty, large_step, largest_step = (
        parts.stream_of(cameras, b1, b2, sealed_section(DETAIL, content), metadata)
        for content in (b"", b"\x40", b"\xff\1\2\3\4")
    )
    faults = [
        ("detail is not empty", empty, "detail", end, "it is empty, it must hold a step"),
        ("step within its limit", large_step, "detail", end, "its step is 64, allowed are 0 to 63"),
        ("step within its limit", largest_step, "detail", end, "its step is 255, allowed are 0 to 63"),
        ("length within the limit", too_long, "detail", end, f"its length is {2**26 + 1}, at most {2**26}"),
        ("the whole payload is there", with_detail[:last], "detail", end, cut_payload),
        ("section CRC-32", changed, "detail", end, "CRC-32 is 0x"),
        ("critical bit of a known kind", not_critical, "0x38", end, "the critical bit of this kind is wrong"),
        ("no kind twice", parts.stream_of(cameras, b1, b2, detail, detail), "detail", last + 1, "it appears twice"),
        ("ascending order", early, "B2", parts.b2_offset + len(detail), "before section detail"),
        ("ascending order", late, "detail", end + len(metadata), "before section metadata"),
    ]
    return [Fault(rule, data, f"section {name} at byte {at}: ", cause) for rule, data, name, at, cause in faults]


def zstd_frame(window: int, content: bytes) -> bytes:
    """Return a zstd frame of one raw block with content size and this window descriptor (RFC 8878, section 3.1.1)."""
    head = bytes.fromhex("28b52ffd 80") + bytes([window]) + len(content).to_bytes(4, "little")
    return head + (len(content) << 3 | 1).to_bytes(3, "little") + content


def metadata_faults(parts: Parts) -> list[Fault]:
    compress = zstandard.ZstdCompressor(level=19).compress
    without_size = zstandard.ZstdCompressor(write_content_size=False).compress(b"{}")
    faults = [
        ("zstd frame valid, nothing after it", b"{}", "no valid zstd frame"),
        ("zstd frame valid, nothing after it", compress(b"{}")[:-1], "no valid zstd frame"),
        ("zstd frame valid, nothing after it", compress(b"{}") + b"\0", "no valid zstd frame"),
        ("stated content size", without_size, "does not state a size of at most 65536 bytes"),
        ("stated content size", compress(bytes(20_000_000)), "does not state a size of at most 65536 bytes"),
        ("window size", zstd_frame(0x70, b"{}"), "its zstd frame has a window of 16777216 bytes, at most 8388608"),
        ("JSON as in section 8", compress(b"{"), "no valid JSON"),
        ("JSON as in section 8", compress(b'{"a":"\xff"}'), "no valid JSON"),
        ("JSON as in section 8", compress(b'{"a":1,"a":2}'), "a key appears twice"),
        ("JSON as in section 8", compress(b'{"a":NaN}'), "NaN is not JSON"),
        ("JSON as in section 8", compress(b'{"a":1e999}'), "the number 1e999 is too large"),
        ("JSON as in section 8", compress(b'{"a":"\\ud800"}'), "no valid JSON"),
        ("JSON as in section 8", compress(b'{"a":' + b"[" * 8 + b"]" * 8 + b"}"), "nested more than 8 deep"),
        ("JSON as in section 8", compress(b"[" * 60_000), "no valid JSON"),
        ("JSON as in section 8", compress(b'{"a":1' + b"0" * 309 + b"}"), "00... is too large"),
        ("the JSON is an object", compress(b"[]"), "its JSON is not an object"),
    ]
    place = f"section metadata at byte {parts.end}"
    return [Fault(rule, parts.with_section(METADATA, payload), place, cause) for rule, payload, cause in faults]


def faults_of(stream: Stream) -> tuple[Fault, ...]:
    """Return variants of a valid stream of two views, two stages and metadata, each of which breaks one rule."""
    parts = Parts(stream)
    return (
        *signature_faults(parts),
        *header_faults(parts),
        *cut_and_changed_section_faults(parts),
        *section_order_faults(parts),
        *camera_payload_faults(parts),
        *camera_value_faults(parts),
        *grid_faults(parts, COVERAGE, COVERAGE_CELLS),
        *grid_faults(parts, FADING, FADING_BLOCKS),
        *metadata_faults(parts),
        *detail_faults(parts),
    )


EXAMPLE = Parts(example_stream())
GOOD = EXAMPLE.good
FAULTS = faults_of(EXAMPLE.stream)
