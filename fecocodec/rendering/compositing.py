"""Splats to pixels: alpha compositing front to back, tile by tile, and its gradient.

Kerbl et al., "3D Gaussian Splatting", 2023, section 4: alpha = opacity * exp(-d^T K d / 2), at most ALPHA_MAX and
nothing below ALPHA_MIN; a pixel stops after the splat that brings its transmittance under TRANSMITTANCE_MIN.
All 16 pixels of a tile's row are computed without branches, so that the row fills vector registers.
"""

import math

import numpy as np

from fecocodec.rendering.compilation import compiled
from fecocodec.rendering.splats import ALPHA_MAX, TRANSMITTANCE_MIN, falloff
from fecocodec.rendering.tiles import TILE_SIZE

_PIXELS = TILE_SIZE * TILE_SIZE
_SIDE = np.uintp(TILE_SIZE)
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_HITS_PER_CHECK = 32  # how often to look whether the whole tile is finished

# Planes of a tile's workspace, each one float32 per pixel. One flat array: the compiler then knows that the planes
# do not overlap and needs no checks in the inner loop.
_TRANSMITTANCE, _RED, _GREEN, _BLUE, _DEPTH = (np.uintp(plane * _PIXELS) for plane in range(5))
_REMAINING, _D_RED, _D_GREEN, _D_BLUE, _D_DEPTH, _D_ALPHA = (np.uintp(plane * _PIXELS) for plane in range(1, 7))


@compiled
def composite(start, stop, first_tile, offsets, splat_of_hit, splats, background, color, depth, alpha):  # type: ignore[no-untyped-def]
    """Write the pixels of the listed tiles start to stop (counted from first_tile)."""
    tile_columns = (alpha.shape[1] + TILE_SIZE - 1) // TILE_SIZE
    workspace = np.empty(5 * _PIXELS, np.float32)
    for listed in range(start, stop):
        top = (first_tile + listed) // tile_columns * TILE_SIZE
        left = (first_tile + listed) % tile_columns * TILE_SIZE
        workspace[:_PIXELS] = _ONE
        workspace[_PIXELS:] = _ZERO
        for hit in range(offsets[listed], offsets[listed + 1]):
            if (hit - offsets[listed]) % _HITS_PER_CHECK == _HITS_PER_CHECK - 1 and _is_finished(workspace):
                break
            _blend(splats[splat_of_hit[hit]], left, top, workspace)
        _write_tile(left, top, workspace, background, color, depth, alpha)


@compiled
def _is_finished(workspace):  # type: ignore[no-untyped-def]
    most = _ZERO
    for pixel in range(_TRANSMITTANCE, _TRANSMITTANCE + np.uintp(_PIXELS)):
        most = max(most, workspace[pixel])
    return most < TRANSMITTANCE_MIN


@compiled
def _row_range(centre_y, radius_y):  # type: ignore[no-untyped-def]
    """First and last row (exclusive) of the tile that a splat reaches; centre_y counts from the first row's centres."""
    first = max(_ZERO, math.ceil(centre_y - radius_y))
    stop = min(np.float32(TILE_SIZE), math.floor(centre_y + radius_y) + _ONE)
    return np.uintp(first), np.uintp(stop)


@compiled
def _blend(splat, left, top, workspace):  # type: ignore[no-untyped-def]
    """Put one splat behind what the tile holds already."""
    centre_x = splat.x - np.float32(left) - _HALF
    centre_y = splat.y - np.float32(top) - _HALF
    half_xx, xy, half_yy = _HALF * splat.conic_xx, splat.conic_xy, _HALF * splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    first_row, stop_row = _row_range(centre_y, splat.radius_y)
    for row in range(first_row, stop_row):
        dy = np.float32(np.int32(row)) - centre_y
        for column in range(_SIDE):
            pixel = row * _SIDE + column
            dx = np.float32(np.int32(column)) - centre_x
            exponent = half_xx * dx * dx + xy * dy * dx + half_yy * dy * dy
            transmittance = workspace[_TRANSMITTANCE + pixel]
            alpha = min(ALPHA_MAX, opacity * falloff(exponent))
            alpha = alpha if exponent <= cutoff and transmittance >= TRANSMITTANCE_MIN else _ZERO
            weight = alpha * transmittance
            workspace[_TRANSMITTANCE + pixel] = transmittance - weight
            workspace[_RED + pixel] += weight * red
            workspace[_GREEN + pixel] += weight * green
            workspace[_BLUE + pixel] += weight * blue
            workspace[_DEPTH + pixel] += weight * depth


@compiled
def _write_tile(left, top, workspace, background, color, depth, alpha):  # type: ignore[no-untyped-def]
    for row in range(np.uintp(min(TILE_SIZE, alpha.shape[0] - top))):
        for column in range(np.uintp(min(TILE_SIZE, alpha.shape[1] - left))):
            pixel = row * _SIDE + column
            y, x = np.uintp(top) + row, np.uintp(left) + column
            transmittance = workspace[_TRANSMITTANCE + pixel]
            covered = _ONE - transmittance
            color[0, y, x] = workspace[_RED + pixel] + transmittance * background[0]
            color[1, y, x] = workspace[_GREEN + pixel] + transmittance * background[1]
            color[2, y, x] = workspace[_BLUE + pixel] + transmittance * background[2]
            depth[y, x] = workspace[_DEPTH + pixel] / covered if covered > _ZERO else _ZERO
            alpha[y, x] = covered


@compiled
def composite_backward(  # type: ignore[no-untyped-def]
    start,
    stop,
    first_tile,
    offsets,
    splat_of_hit,
    splats,
    color,
    depth,
    alpha,
    d_color,
    d_depth,
    d_alpha,
    hit_gradients,
):
    """Write the gradients of each hit of the listed tiles start to stop, columns as DIFFERENTIABLE_FIELDS.

    Walks front to back like `composite`: what lies behind a splat is the finished pixel less what lies in front.
    """
    tile_columns = (alpha.shape[1] + TILE_SIZE - 1) // TILE_SIZE
    workspace = np.empty(7 * _PIXELS, np.float32)
    for listed in range(start, stop):
        top = (first_tile + listed) // tile_columns * TILE_SIZE
        left = (first_tile + listed) % tile_columns * TILE_SIZE
        workspace[:_PIXELS] = _ONE
        workspace[_PIXELS:] = _ZERO
        _read_tile(left, top, color, depth, alpha, d_color, d_depth, d_alpha, workspace)
        is_finished = False
        for hit in range(offsets[listed], offsets[listed + 1]):
            if not is_finished and (hit - offsets[listed]) % _HITS_PER_CHECK == _HITS_PER_CHECK - 1:
                is_finished = _is_finished(workspace)
            if is_finished:
                hit_gradients[hit, :] = _ZERO
            else:
                _blend_backward(splats[splat_of_hit[hit]], left, top, workspace, hit_gradients[hit])


@compiled
def _read_tile(left, top, color, depth, alpha, d_color, d_depth, d_alpha, workspace):  # type: ignore[no-untyped-def]
    """Fetch a tile's gradients, and REMAINING = sum over its splats of weight * gradient of that weight.

    With depth = sum(w z) / alpha, dL/dw = d_color . color_i + d_depth / alpha * z_i + (d_alpha - d_depth * depth / alpha);
    summed over the splats, the two parts of depth cancel. The background counts as the last splat.
    """
    for row in range(np.uintp(min(TILE_SIZE, alpha.shape[0] - top))):
        for column in range(np.uintp(min(TILE_SIZE, alpha.shape[1] - left))):
            pixel = row * _SIDE + column
            y, x = np.uintp(top) + row, np.uintp(left) + column
            red, green, blue, covered = d_color[0, y, x], d_color[1, y, x], d_color[2, y, x], alpha[y, x]
            per_depth = d_depth[y, x] / covered if covered > _ZERO else _ZERO
            workspace[_D_RED + pixel], workspace[_D_GREEN + pixel], workspace[_D_BLUE + pixel] = red, green, blue
            workspace[_D_DEPTH + pixel] = per_depth
            workspace[_D_ALPHA + pixel] = d_alpha[y, x] - per_depth * depth[y, x]
            workspace[_REMAINING + pixel] = (
                red * color[0, y, x] + green * color[1, y, x] + blue * color[2, y, x] + d_alpha[y, x] * covered
            )


@compiled
def _blend_backward(splat, left, top, workspace, gradient):  # type: ignore[no-untyped-def]
    centre_x = splat.x - np.float32(left) - _HALF
    centre_y = splat.y - np.float32(top) - _HALF
    xx, xy, yy = splat.conic_xx, splat.conic_xy, splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    sum_red, sum_green, sum_blue, sum_depth, sum_opacity = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    sum_x, sum_y, sum_xx, sum_xy, sum_yy = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    first_row, stop_row = _row_range(centre_y, splat.radius_y)
    for row in range(first_row, stop_row):
        dy = np.float32(np.int32(row)) - centre_y
        for column in range(_SIDE):
            pixel = row * _SIDE + column
            dx = np.float32(np.int32(column)) - centre_x
            exponent = _HALF * xx * dx * dx + xy * dy * dx + _HALF * yy * dy * dy
            transmittance = workspace[_TRANSMITTANCE + pixel]
            visible = falloff(exponent)
            unclamped = opacity * visible
            alpha = min(ALPHA_MAX, unclamped)
            alpha = alpha if exponent <= cutoff and transmittance >= TRANSMITTANCE_MIN else _ZERO
            weight = alpha * transmittance
            workspace[_TRANSMITTANCE + pixel] = transmittance - weight
            d_red, d_green = workspace[_D_RED + pixel], workspace[_D_GREEN + pixel]
            d_blue, d_depth = workspace[_D_BLUE + pixel], workspace[_D_DEPTH + pixel]
            d_weight = red * d_red + green * d_green + blue * d_blue + depth * d_depth + workspace[_D_ALPHA + pixel]
            behind = workspace[_REMAINING + pixel] - weight * d_weight
            workspace[_REMAINING + pixel] = behind
            d_alpha = transmittance * d_weight - behind / (_ONE - alpha)
            d_alpha = d_alpha if alpha > _ZERO and unclamped < ALPHA_MAX else _ZERO
            sum_red += weight * d_red
            sum_green += weight * d_green
            sum_blue += weight * d_blue
            sum_depth += weight * d_depth
            sum_opacity += d_alpha * visible
            d_exponent = -d_alpha * unclamped
            along_x, along_y = d_exponent * dx, d_exponent * dy
            sum_x += along_x
            sum_y += along_y
            sum_xx += along_x * dx
            sum_xy += along_x * dy
            sum_yy += along_y * dy
    gradient[0] = -(xx * sum_x + xy * sum_y)
    gradient[1] = -(xy * sum_x + yy * sum_y)
    gradient[2], gradient[3], gradient[4] = _HALF * sum_xx, sum_xy, _HALF * sum_yy
    gradient[5] = sum_opacity
    gradient[6], gradient[7], gradient[8], gradient[9] = sum_red, sum_green, sum_blue, sum_depth
