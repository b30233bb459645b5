# mypy: allow-untyped-defs
"""Lists of the splats that touch each tile of the image, front to back. A hit is one splat in one tile."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32, Int64

from fecocodec.kernels.compilation import compiled

TILE_SIZE = 32  # pixels a side, a multiple of the lanes of a vector; its planes fit into the first cache
_MAX_HITS = 2**21  # hits in memory at once: about 100 MB of lists and gradients
_BITS_OF_DIGIT, _NUM_DIGITS = 11, 3  # of the radix sort of 32-bit depths


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
    """Return the indices of the splats by ascending depth; equal depths keep the order of the Gaussians."""
    keys, order = splats["depth"].view(np.uint32), np.arange(len(splats), dtype=np.int32)
    for digit in range(_NUM_DIGITS):  # bits of positive floats sort as integers
        keys, order = _sorted_by_digit(keys, order, np.uint32(digit * _BITS_OF_DIGIT))
    return order


def tile_lists(
    splats: np.ndarray, order: Int32[np.ndarray, " visible"], image_size: tuple[int, int]
) -> Iterator[TileLists]:
    """Yield lists that cover the image once: usually one, several where large splats would need too much memory."""
    rows, columns = (-(-pixels // TILE_SIZE) for pixels in image_size)
    counts, reached = np.zeros(rows * columns, np.int64), np.empty((len(splats), 4), np.int32)
    _count_hits(splats, rows, columns, counts, reached)
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        hits_before = ends[first] - counts[first]
        stop = max(first + 1, int(np.searchsorted(ends, hits_before + _MAX_HITS, side="right")))
        offsets = np.concatenate(([0], ends[first:stop] - hits_before))
        splat_of_hit = np.empty(offsets[-1], np.int32)
        _list_hits(reached, order, columns, first, stop, offsets[:-1].copy(), splat_of_hit)
        yield TileLists(first, stop, offsets, splat_of_hit)
        first = stop


@compiled
def _tile_range(centre, radius, count):
    """Return the first and last (exclusive) tile along one axis with a pixel centre within the radius."""
    end = count * TILE_SIZE
    low = min(max(centre - radius - 0.5, 0.0), float(end))
    stop = int(min(max(centre + radius + 0.5, 0.0), float(end)))  # pixels up to the last one reached
    first = int(low) + (int(low) < low)
    return first // TILE_SIZE, (stop + TILE_SIZE - 1) // TILE_SIZE


@compiled
def _sorted_by_digit(keys, order, shift):
    """Sort by one digit of the keys, a step of radix sort: elements with equal digits keep their order."""
    place = np.zeros((1 << _BITS_OF_DIGIT) + 1, np.int64)
    mask = np.uint32((1 << _BITS_OF_DIGIT) - 1)
    for key in keys:
        place[((key >> shift) & mask) + 1] += 1
    place = np.cumsum(place)
    sorted_keys, sorted_order = np.empty(len(keys), np.uint32), np.empty(len(keys), np.int32)
    for i in range(len(keys)):
        digit = (keys[i] >> shift) & mask
        sorted_keys[place[digit]], sorted_order[place[digit]] = keys[i], order[i]
        place[digit] += 1
    return sorted_keys, sorted_order


@compiled
def _count_hits(splats, rows, columns, counts, reached):
    """Count the splats of each tile; reached: first and last (exclusive) row and column of tiles of each splat."""
    for i in range(len(splats)):
        if splats[i].radius_x == 0.0:  # not drawn, see `shade`
            reached[i] = 0
            continue
        first_row, stop_row = _tile_range(splats[i].y, splats[i].radius_y, rows)
        first_column, stop_column = _tile_range(splats[i].x, splats[i].radius_x, columns)
        reached[i, 0], reached[i, 1], reached[i, 2], reached[i, 3] = first_row, stop_row, first_column, stop_column
        for row in range(first_row, stop_row):
            for column in range(first_column, stop_column):
                counts[row * columns + column] += 1


@compiled
def _list_hits(reached, order, columns, first, stop, position, splat_of_hit):
    """Write the index of each splat into the lists of its tiles; position: index of each list's next entry."""
    for i in order:
        for row in range(max(reached[i, 0], first // columns), min(reached[i, 1], (stop - 1) // columns + 1)):
            for column in range(reached[i, 2], reached[i, 3]):
                tile = row * columns + column
                if first <= tile < stop:
                    splat_of_hit[position[tile - first]] = i
                    position[tile - first] += 1


@compiled
def sum_hits(splat_of_hit, hit_gradients, gradients):
    """Add the gradients of each hit, [hit field], to those of its splat, [splat field], in a fixed order."""
    for hit in range(len(splat_of_hit)):
        for field in range(gradients.shape[1]):
            gradients[splat_of_hit[hit], field] += hit_gradients[hit, field]
