"""Streams for tests: a fixed one, generated ones, and ones with arbitrary bytes and valid CRCs."""

import struct
import zlib

from hypothesis import strategies as st

from fecocodec.container import (
    COVERAGE_CELLS,
    FADING_BLOCKS,
    LAMBDA_Q_MAX,
    MAX_DETAIL_STEP,
    Detail,
    FormatVersion,
    Header,
    PackedCameras,
    Stream,
)

SIGNATURE = b"\x89FCS\r\n\x1a\n"
CAMERAS, COVERAGE, FADING, B1, B2, DETAIL, METADATA = 0x90, 0x98, 0x9C, 0xA0, 0xB0, 0xB8, 0x40
TURNED = (0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6)  # a rotation with exact decimals


def float32(value: float) -> float:
    rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return rounded


def pose(rotation: tuple[float, ...], position: tuple[float, ...]) -> tuple[float, ...]:
    rows = (rotation[3 * row : 3 * row + 3] + position[row : row + 1] for row in range(3))
    return tuple(float32(value) for row in rows for value in row)


def example_cameras() -> PackedCameras:
    level = pose((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    turned = pose(TURNED, (0.25, -1.5, 3.3))
    lens = tuple(float32(value) for value in (0.9, 1.6, 0.5, 0.5))
    return PackedCameras((level, turned), (lens, lens), 0.5, 100.0)


def example_stream() -> Stream:
    """Return a stream of two views and two stages with metadata."""
    header = Header(b"modelid8", 2, 256, 448, 1179, (b"digest 1", b"digest 2"))
    return Stream(header, example_cameras(), (b"first payload", b"second payload"), {"name": "fox", "views": [2, 4]})


def sealed_section(kind: int, payload: bytes) -> bytes:
    head = struct.pack("<BI", kind, len(payload))
    return head + struct.pack("<I", zlib.crc32(head + payload)) + payload


def sealed_header(
    like: Header, *, major: int = 2, minor: int = 0, views: int | None = None, stages: int | None = None,
    height: int | None = None, width: int | None = None, lambda_q: int | None = None, sections: int = 4,
    excess: int = 0,
) -> bytes:  # fmt: skip
    """Return the header of a stream of two stages, with arbitrary fields and a valid CRC."""
    stages = like.num_stages if stages is None else stages
    fields = (
        *(major, minor, like.model_id, like.num_views if views is None else views, stages),
        *(like.height if height is None else height, like.width if width is None else width),
        *(like.lambda_q if lambda_q is None else lambda_q, sections, excess),
    )
    digests = b"".join(like.symbol_digests)[: 8 * stages]
    content = SIGNATURE + struct.pack("<BB8sBBHHHBB", *fields) + digests
    return content + struct.pack("<I", zlib.crc32(content))


@st.composite
def rotations(draw: st.DrawFn) -> tuple[float, ...]:
    """Draw rotations from quaternions, rounded to float32, row-major."""
    w, x, y, z = (draw(st.floats(-1, 1)) for _ in range(4))
    square = w * w + x * x + y * y + z * z
    if square < 1e-3:
        return TURNED
    s = 2.0 / square
    return tuple(
        float32(value)
        for value in (
            1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
            s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w),
            s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y),
        )
    )  # fmt: skip


positions = st.tuples(*[st.floats(-512, 512, width=32)] * 3)
lenses = st.tuples(*[st.floats(0.125, 16, width=32)] * 2, *[st.floats(-1, 2, width=32)] * 2)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=4,
)


@st.composite
def coverages(draw: st.DrawFn, header: Header) -> bytes:
    """Draw a bitmap of cells."""
    views, rows, columns = COVERAGE_CELLS.shape(header)
    return draw(patterns(views * rows * columns // 8))


@st.composite
def fadings(draw: st.DrawFn, header: Header) -> bytes:
    """Draw levels of blocks."""
    views, rows, columns = FADING_BLOCKS.shape(header)
    return draw(patterns(views * rows * columns // 4))


details = st.builds(Detail, st.integers(0, MAX_DETAIL_STEP), st.binary(max_size=64))


@st.composite
def patterns(draw: st.DrawFn, size: int) -> bytes:
    """Draw bytes that repeat few values, because drawing thousands of them is slow."""
    pattern = draw(st.binary(min_size=1, max_size=4))
    return (pattern * size)[:size]


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    """Draw a valid stream."""
    views = draw(st.integers(1, 16))
    lens = draw(lenses)
    near = draw(st.floats(0.0625, 8, width=32))
    cameras = PackedCameras(
        tuple(pose(draw(rotations()), draw(positions)) for _ in range(views)),
        (lens,) * views if draw(st.booleans()) else tuple(draw(lenses) for _ in range(views)),
        near,
        float32(near * draw(st.floats(1.5, 16_000))),
    )
    stages = draw(st.integers(1, 2))
    eight_bytes = st.binary(min_size=8, max_size=8)
    header = Header(
        model_id=draw(eight_bytes),
        num_views=views,
        height=draw(st.integers(64, 1024)),
        width=draw(st.integers(64, 1024)),
        lambda_q=draw(st.integers(0, LAMBDA_Q_MAX)),
        symbol_digests=tuple(draw(eight_bytes) for _ in range(stages)),
        first_stage_excess=draw(st.integers(0, 255)) if stages == 2 else 0,
        version=FormatVersion(2, draw(st.integers(0, 255))),
    )
    metadata = draw(st.none() | st.dictionaries(st.text(max_size=4), json_values, max_size=3))
    payloads = tuple(draw(st.binary(max_size=64)) for _ in range(stages))
    coverage, fading = draw(st.none() | coverages(header)), draw(st.none() | fadings(header))
    return Stream(header, cameras, payloads, metadata, coverage, fading, draw(st.none() | details))
