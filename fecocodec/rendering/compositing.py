# mypy: allow-untyped-defs
"""Alpha compositing of splats to pixels, front to back, tile by tile.

Kerbl et al., "3D Gaussian Splatting", 2023, section 4: alpha = opacity * exp(-d^T K d / 2), clamped to ALPHA_MAX
and skipped below ALPHA_MIN; a pixel is finished once its transmittance is under TRANSMITTANCE_MIN.

The 16 pixels of a tile's row are computed without branches, so that the loop vectorises. For that reason indices are
unsigned (a signed index may count from the end, which needs a check), and the values of a tile are planes of one flat
array (which cannot overlap).
"""

import math

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.splats import ALPHA_MAX, TRANSMITTANCE_MIN, falloff
from fecocodec.rendering.tiles import TILE_SIZE

SIDE = np.uintp(TILE_SIZE)
PIXELS = np.uintp(TILE_SIZE * TILE_SIZE)  # pixels of a tile, and length of one plane
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

# Offsets of the planes of a tile. `has_light_left` relies on transmittance being first.
_TRANSMITTANCE, _RED, _GREEN, _BLUE, _DEPTH, _END = (np.uintp(plane) * PIXELS for plane in range(6))

_HITS_PER_CHECK = 32  # hits between two checks whether the whole tile is finished


@compiled
def composite(start, stop, first_tile, offsets, splat_of_hit, splats, background, color, depth, alpha):
    """Write the pixels of the listed tiles in [start, stop), counted from first_tile."""
    planes = np.empty(_END, np.float32)
    for listed in range(start, stop):
        left, top = tile_corner(first_tile + listed, alpha.shape[1])
        planes[:PIXELS] = ONE
        planes[PIXELS:] = ZERO
        for hit in range(offsets[listed], offsets[listed + 1]):
            if not has_light_left(hit - offsets[listed], planes):
                break
            _blend(splats[splat_of_hit[hit]], left, top, planes)
        _write_tile(left, top, planes, background, color, depth, alpha)


@compiled
def tile_corner(tile, width):
    """Return the column and row of the tile's first pixel."""
    tile_columns = (width + TILE_SIZE - 1) // TILE_SIZE
    return tile % tile_columns * TILE_SIZE, tile // tile_columns * TILE_SIZE


@compiled
def has_light_left(num_blended, planes):
    """Return False if every pixel of the tile is finished; checked once in _HITS_PER_CHECK hits."""
    if num_blended % _HITS_PER_CHECK != _HITS_PER_CHECK - 1:
        return True
    most = ZERO
    for pixel in range(PIXELS):
        most = max(most, planes[pixel])
    return most >= TRANSMITTANCE_MIN


@compiled
def row_range(centre_y, radius_y):
    """Return the first and last (exclusive) row of a tile that a splat reaches.

    centre_y: in pixels from the centres of the tile's first row. Rows are clamped to the tile, because far outside the
    image rounding can list a splat in a tile that it does not reach.
    """
    first = min(max(math.ceil(centre_y - radius_y), ZERO), np.float32(TILE_SIZE))
    stop = min(max(math.floor(centre_y + radius_y) + ONE, ZERO), np.float32(TILE_SIZE))
    return np.uintp(first), np.uintp(stop)


@compiled
def _blend(splat, left, top, planes):
    """Blend one splat behind those already blended."""
    centre_x = splat.x - np.float32(left) - HALF
    centre_y = splat.y - np.float32(top) - HALF
    half_xx, xy, half_yy = HALF * splat.conic_xx, splat.conic_xy, HALF * splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    first_row, stop_row = row_range(centre_y, splat.radius_y)
    for row in range(first_row, stop_row):
        dy = np.float32(np.int32(row)) - centre_y
        for column in range(SIDE):
            pixel = row * SIDE + column
            dx = np.float32(np.int32(column)) - centre_x
            exponent = half_xx * dx * dx + xy * dy * dx + half_yy * dy * dy
            transmittance = planes[_TRANSMITTANCE + pixel]
            alpha = min(ALPHA_MAX, opacity * falloff(exponent))
            alpha = alpha if exponent <= cutoff and transmittance >= TRANSMITTANCE_MIN else ZERO
            weight = alpha * transmittance
            planes[_TRANSMITTANCE + pixel] = transmittance - weight
            planes[_RED + pixel] += weight * red
            planes[_GREEN + pixel] += weight * green
            planes[_BLUE + pixel] += weight * blue
            planes[_DEPTH + pixel] += weight * depth


@compiled
def _write_tile(left, top, planes, background, color, depth, alpha):
    """Write the part of the tile that lies inside the image, over the background."""
    for row in range(min(TILE_SIZE, alpha.shape[0] - top)):
        for column in range(min(TILE_SIZE, alpha.shape[1] - left)):
            pixel = np.uintp(row * TILE_SIZE + column)
            y, x = top + row, left + column
            transmittance = planes[_TRANSMITTANCE + pixel]
            covered = ONE - transmittance
            color[0, y, x] = planes[_RED + pixel] + transmittance * background[0]
            color[1, y, x] = planes[_GREEN + pixel] + transmittance * background[1]
            color[2, y, x] = planes[_BLUE + pixel] + transmittance * background[2]
            depth[y, x] = planes[_DEPTH + pixel] / covered if covered > ZERO else ZERO
            alpha[y, x] = covered
