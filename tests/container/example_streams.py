"""Streams for tests: a fixed one, generated ones, and ones with arbitrary bytes and valid CRCs."""

import struct
import zlib
from math import prod

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
from fecocodec.container.view_grids import ViewGrids

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


def sealed_header(like: Header, **fields: int) -> bytes:
    """Return a header with a valid CRC and any fields, by default those of `like` and four sections.

    fields: major, minor, views, stages, height, width, lambda_q, sections, excess.
    """
    usual = {"major": 2, "minor": 0, "views": like.num_views, "stages": like.num_stages, "height": like.height}
    usual |= {"width": like.width, "lambda_q": like.lambda_q, "sections": 4, "excess": 0}
    major, minor, *others = (usual | fields).values()
    digests = b"".join(like.symbol_digests)[: 8 * others[1]]
    content = SIGNATURE + struct.pack("<BB8sBBHHHBB", major, minor, like.model_id, *others) + digests
    return content + struct.pack("<I", zlib.crc32(content))


def grid_bytes(grids: ViewGrids, header: Header) -> int:
    """Return the size of the values of coverage or fading."""
    return prod(grids.shape(header)) * grids.bits // 8


def rotation_of(w: float, x: float, y: float, z: float) -> tuple[float, ...]:
    """Return the rotation of a quaternion of any length, row-major."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
        s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w),
        s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y),
    )  # fmt: skip


quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda wxyz: sum(value**2 for value in wxyz) > 1e-3)


positions = st.tuples(*[st.floats(-512, 512, width=32)] * 3)
lenses = st.tuples(*[st.floats(0.125, 16, width=32)] * 2, *[st.floats(-1, 2, width=32)] * 2)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=4,
)


details = st.builds(Detail, st.integers(0, MAX_DETAIL_STEP), st.binary(max_size=64))


def patterns(size: int) -> st.SearchStrategy[bytes]:
    """Draw bytes that repeat few values, because drawing thousands of them is slow."""
    return st.binary(min_size=1, max_size=4).map(lambda pattern: (pattern * size)[:size])


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    """Draw a valid stream."""
    views = draw(st.integers(1, 16))
    lens = draw(lenses)
    near = draw(st.floats(0.0625, 8, width=32))
    cameras = PackedCameras(
        tuple(pose(rotation_of(*draw(quaternions)), draw(positions)) for _ in range(views)),
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
    coverage, fading = (
        draw(st.none() | patterns(grid_bytes(grids, header))) for grids in (COVERAGE_CELLS, FADING_BLOCKS)
    )
    return Stream(header, cameras, payloads, metadata, coverage, fading, draw(st.none() | details))
