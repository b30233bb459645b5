# mypy: allow-untyped-defs
"""Lists of the splats that touch each tile of the image, front to back. A hit is one splat in one tile."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, Int64

from fecocodec.kernels.compilation import compiled

TILE_SIZE = 16  # pixels a side
_MAX_HITS = 2**21  # hits in memory at once: about 100 MB of lists and gradients
_INDEX_BITS = np.uint64(32)


@dataclass(frozen=True)
class TileLists:
    """Splats of the tiles in [first, stop), front to back; tiles are numbered row by row.

    The splats of tile t are splat_of_hit[offsets[t - first] : offsets[t - first + 1]].
    """

    first: int
    stop: int
    offsets: Int64[np.ndarray, " tiles_plus_1"]
    splat_of_hit: Int32[np.ndarray, " hits"]


def front_to_back(splats: np.ndarray) -> Int32[np.ndarray, " visible"]:
    """Return the indices of the visible splats by ascending depth; equal depths keep the order of the Gaussians."""
    visible = np.flatnonzero(splats["radius_x"] > 0).astype(np.uint64)
    # Bits of positive floats sort as integers; with the index in the low bits, one integer sort is unambiguous.
    depth_bits = splats["depth"][visible].view(np.uint32).astype(np.uint64)
    keys = np.sort((depth_bits << _INDEX_BITS) | visible)
    return keys.astype(np.uint32).astype(np.int32)


def tile_lists(
    splats: np.ndarray, order: Int32[np.ndarray, " visible"], image_size: tuple[int, int]
) -> Iterator[TileLists]:
    """Yield lists that cover the image once: usually one, several where large splats would need too much memory."""
    rows, columns = (-(-pixels // TILE_SIZE) for pixels in image_size)
    counts = np.zeros(rows * columns, np.int64)
    _count_hits(splats, order, rows, columns, counts)
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        hits_before = ends[first] - counts[first]
        stop = max(first + 1, int(np.searchsorted(ends, hits_before + _MAX_HITS, side="right")))
        offsets = np.concatenate(([0], ends[first:stop] - hits_before))
        splat_of_hit = np.empty(offsets[-1], np.int32)
        _list_hits(splats, order, rows, columns, first, stop, offsets[:-1].copy(), splat_of_hit)
        yield TileLists(first, stop, offsets, splat_of_hit)
        first = stop


def sum_over_tiles(
    lists: TileLists, hit_gradients: Float32[np.ndarray, "hits fields"], gradients: Float32[np.ndarray, "n fields"]
) -> None:
    """Add the gradients of each hit to those of its splat, in a fixed order."""
    _sum_hits(lists.splat_of_hit, hit_gradients, gradients)


@compiled
def _tile_range(centre, radius, count):
    """Return the first and last (exclusive) tile along one axis with a pixel centre within the radius."""
    low = np.floor((np.ceil(centre - radius - 0.5)) / TILE_SIZE)
    high = np.floor((np.floor(centre + radius - 0.5)) / TILE_SIZE) + 1.0
    return int(min(max(low, 0.0), float(count))), int(min(max(high, 0.0), float(count)))


@compiled
def _count_hits(splats, order, rows, columns, counts):
    for i in order:
        first_row, stop_row = _tile_range(splats[i].y, splats[i].radius_y, rows)
        first_column, stop_column = _tile_range(splats[i].x, splats[i].radius_x, columns)
        for row in range(first_row, stop_row):
            for column in range(first_column, stop_column):
                counts[row * columns + column] += 1


@compiled
def _list_hits(splats, order, rows, columns, first, stop, position, splat_of_hit):
    """Write the index of each splat into the lists of its tiles; position: index of each list's next entry."""
    for i in order:
        first_row, stop_row = _tile_range(splats[i].y, splats[i].radius_y, rows)
        first_column, stop_column = _tile_range(splats[i].x, splats[i].radius_x, columns)
        for row in range(max(first_row, first // columns), min(stop_row, (stop - 1) // columns + 1)):
            for column in range(first_column, stop_column):
                tile = row * columns + column
                if first <= tile < stop:
                    splat_of_hit[position[tile - first]] = i
                    position[tile - first] += 1


@compiled
def _sum_hits(splat_of_hit, hit_gradients, gradients):
    for hit in range(len(splat_of_hit)):
        for field in range(gradients.shape[1]):
            gradients[splat_of_hit[hit], field] += hit_gradients[hit, field]
