"""What of a scene is emitted: factors of opacities (FORMAT.md, sections 8.1 and 8.2), parts of the background layer."""

import numpy as np
from jaxtyping import Float32, UInt8

from fecocodec.container import COVERAGE_CELLS, FADING_BLOCKS, Header, Stream
from fecocodec.grid import FADING, FEATURES, PER_CELL

MOST_VIEWS_FILLED = 8
FACTOR_OF_LEVEL = (3 - np.arange(4, dtype=np.float32)) / np.float32(3)


def visibility_of(stream: Stream, gaussians_per_side: int = PER_CELL) -> Float32[np.ndarray, " n"] | None:
    """Return the factor in [0, 1] of each Gaussian's opacity, ordered (view, row, column); None if all are 1.

    gaussians_per_side: of a cell, 4x4 pixels; 2 for one Gaussian per 2x2 pixels.
    """
    factors = []
    if stream.coverage is not None:
        cells = np.unpackbits(np.frombuffer(stream.coverage, np.uint8)).reshape(COVERAGE_CELLS.shape(stream.header))
        factors.append(_enlarged(cells.astype(np.float32), gaussians_per_side))
    if stream.fading is not None:
        levels = unpack_levels(stream.fading, stream.header)
        factors.append(_enlarged(FACTOR_OF_LEVEL[levels], FADING // FEATURES * gaussians_per_side))
    return np.prod(factors, axis=0).reshape(-1) if factors else None


def is_filled_behind(num_views: int, has_coverage: bool) -> bool:
    """Return whether the background layer of a scene has a part behind near surfaces.

    Behind a cut-out object nothing is to be seen, and many views together show most of what is behind their surfaces.
    """
    return num_views <= MOST_VIEWS_FILLED and not has_coverage


def pack_levels(levels: UInt8[np.ndarray, "view row column"]) -> bytes:
    """Pack levels in [0, 3], of the shape that `FADING_BLOCKS.shape` returns, into the bytes of `Stream.fading`."""
    of_byte = levels.reshape(-1, 4) << np.array([6, 4, 2, 0], np.uint8)
    return np.bitwise_or.reduce(of_byte, axis=1).astype(np.uint8).tobytes()


def unpack_levels(data: bytes, header: Header) -> UInt8[np.ndarray, "view row column"]:
    """Invert `pack_levels`."""
    levels = np.frombuffer(data, np.uint8)[:, None] >> np.array([6, 4, 2, 0], np.uint8) & 3
    return levels.reshape(FADING_BLOCKS.shape(header))


def _enlarged(
    values: Float32[np.ndarray, "view row column"], factor: int
) -> Float32[np.ndarray, "view larger_row larger_column"]:
    return values.repeat(factor, axis=1).repeat(factor, axis=2)
