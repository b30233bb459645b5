# mypy: allow-untyped-defs
"""Alpha compositing of splats to pixels, front to back, tile by tile.

Kerbl et al., "3D Gaussian Splatting", 2023, section 4: alpha = opacity * exp(-d^T K d / 2), clamped to ALPHA_MAX
and skipped below ALPHA_MIN; a pixel is finished once its transmittance is under TRANSMITTANCE_MIN.

A splat is computed in columns of 16 pixels, the lanes of a vector, from its own left edge on. The values of a tile are
planes of one flat array. Their indices are unsigned: a signed index may count from the end, which needs a check.
"""

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.lanes import NUM_LANES, lane_numbers, lanes, load, store, total, where
from fecocodec.rendering.splats import ALPHA_MAX, TRANSMITTANCE_MIN, falloff
from fecocodec.rendering.tiles import TILE_SIZE

LANES = np.uintp(NUM_LANES)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

# A row of a tile holds the row of each plane, one after another: planes one page apart would slow each other down.
# Beside the tile there is room for a vector that begins at its last pixel; transmittance is zero there.
_NUM_PLANES = 7  # of `compositing_backward`; here 5
PLANE = np.uintp(TILE_SIZE + NUM_LANES)  # from a number in one plane to the same in the next
ROW = _NUM_PLANES * PLANE  # from a number to the one below
PLANES_OF_TILE = TILE_SIZE * ROW
_TRANSMITTANCE, _RED, _GREEN, _BLUE, _DEPTH = (np.uintp(plane) * PLANE for plane in range(5))

_HITS_PER_CHECK = 32  # hits between two checks whether the whole tile is finished


@compiled
def composite(start, stop, first_tile, offsets, splat_of_hit, splats, background, color, depth, alpha):
    """Write the pixels of the listed tiles in [start, stop), counted from first_tile."""
    planes = np.empty(PLANES_OF_TILE, np.float32)
    for listed in range(start, stop):
        left, top, width, height = tile_box(first_tile + listed, alpha)
        clear(width, height, planes)
        for hit in range(offsets[listed], offsets[listed + 1]):
            if not has_light_left(hit - offsets[listed], planes):
                break
            _blend(splats[splat_of_hit[hit]], left, top, planes)
        _write_tile(left, top, width, height, planes, background, color, depth, alpha)


@compiled
def tile_box(tile, image):
    """Return the column and row of the tile's first pixel, and its width and height inside the image."""
    height, width = image.shape
    tile_columns = (width + TILE_SIZE - 1) // TILE_SIZE
    left, top = tile % tile_columns * TILE_SIZE, tile // tile_columns * TILE_SIZE
    return left, top, min(TILE_SIZE, width - left), min(TILE_SIZE, height - top)


@compiled
def pixel_index(row, column):
    """Return the index of a pixel of the tile in the first plane."""
    return np.uintp(row) * ROW + np.uintp(column)


@compiled
def clear(width, height, planes):
    """Set transmittance, the first plane, to one inside the image and all else to zero."""
    planes[:] = ZERO
    for row in range(height):
        for column in range(width):
            planes[pixel_index(row, column)] = ONE


@compiled
def has_light_left(num_blended, planes):
    """Return False if every pixel of the tile is finished; checked once in _HITS_PER_CHECK hits."""
    if num_blended % _HITS_PER_CHECK != _HITS_PER_CHECK - 1:
        return True
    most = lanes(ZERO)
    for row in range(TILE_SIZE):
        for column in range(0, TILE_SIZE, NUM_LANES):
            most = max(most, load(planes, pixel_index(row, column)))
    return total(where(most >= TRANSMITTANCE_MIN, ONE, ZERO)) > ZERO


@compiled
def reach(centre, radius):
    """Return the first and last (exclusive) row or column of a tile that a splat reaches.

    centre: in pixels from the centres of the tile's first row or column. The result is clamped to the tile, because far
    outside the image rounding can list a splat in a tile that it does not reach.
    """
    low = min(max(centre - radius, ZERO), np.float32(TILE_SIZE))
    first, stop = np.int32(low), np.int32(min(max(centre + radius + ONE, ZERO), np.float32(TILE_SIZE)))
    return np.uintp(first + (np.float32(first) < low)), np.uintp(stop)


@compiled
def _blend(splat, left, top, planes):
    """Blend one splat behind those already blended."""
    centre_x = splat.x - np.float32(left) - HALF
    centre_y = splat.y - np.float32(top) - HALF
    half_xx, xy, half_yy = HALF * splat.conic_xx, splat.conic_xy, HALF * splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    first_row, stop_row = reach(centre_y, splat.radius_y)
    column, stop_column = reach(centre_x, splat.radius_x)
    while column < stop_column:
        dx = lane_numbers() - (centre_x - np.float32(np.int32(column)))
        of_x, of_xy = half_xx * dx * dx, xy * dx
        for row in range(first_row, stop_row):
            pixel = pixel_index(row, column)
            dy = np.float32(np.int32(row)) - centre_y
            exponent = of_x + of_xy * dy + half_yy * dy * dy
            transmittance = load(planes, _TRANSMITTANCE + pixel)
            alpha = min(opacity * falloff(exponent), ALPHA_MAX)
            alpha = where((exponent <= cutoff) & (transmittance >= TRANSMITTANCE_MIN), alpha, ZERO)
            weight = alpha * transmittance
            store(planes, _TRANSMITTANCE + pixel, transmittance - weight)
            store(planes, _RED + pixel, load(planes, _RED + pixel) + weight * red)
            store(planes, _GREEN + pixel, load(planes, _GREEN + pixel) + weight * green)
            store(planes, _BLUE + pixel, load(planes, _BLUE + pixel) + weight * blue)
            store(planes, _DEPTH + pixel, load(planes, _DEPTH + pixel) + weight * depth)
        column += LANES


@compiled
def _write_tile(left, top, width, height, planes, background, color, depth, alpha):
    """Write the tile to the images, over the background."""
    for row in range(height):
        for column in range(width):
            pixel, y, x = pixel_index(row, column), top + row, left + column
            transmittance = planes[_TRANSMITTANCE + pixel]
            covered = ONE - transmittance
            color[0, y, x] = planes[_RED + pixel] + transmittance * background[0]
            color[1, y, x] = planes[_GREEN + pixel] + transmittance * background[1]
            color[2, y, x] = planes[_BLUE + pixel] + transmittance * background[2]
            depth[y, x] = planes[_DEPTH + pixel] / covered if covered > ZERO else ZERO
            alpha[y, x] = covered
