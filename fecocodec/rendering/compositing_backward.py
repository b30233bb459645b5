# mypy: allow-untyped-defs
"""Gradient of `compositing`: from pixels back to the splats of each tile.

Processes splats front to back like `composite`. The contribution of the splats behind a splat is the final pixel minus
the contribution of those in front, so nothing is stored per pair of splat and pixel.
"""

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.compositing import HALF, ONE, PIXELS, SIDE, ZERO, has_light_left, row_range, tile_corner
from fecocodec.rendering.splats import ALPHA_MAX, TRANSMITTANCE_MIN, falloff
from fecocodec.rendering.tiles import TILE_SIZE

# Offsets of the planes of a tile. BEHIND is the sum of weight * dL/d(weight) over the splats not yet processed.
_TRANSMITTANCE, _BEHIND, _D_RED, _D_GREEN, _D_BLUE, _D_DEPTH, _D_ALPHA, _END = (
    np.uintp(plane) * PIXELS for plane in range(8)
)

# Offsets of the sums over the columns of a tile. Gradients are summed over rows first, as vectors, then once per splat
# over columns. FALL is dL/d(alpha) * alpha; _Y and _YY are its moments along y.
_RED, _GREEN, _BLUE, _DEPTH, _FALL, _FALL_Y, _FALL_YY, _END_OF_SUMS = (np.uintp(field) * SIDE for field in range(8))


@compiled
def composite_backward(start, stop, first_tile, offsets, splat_of_hit, splats, images, d_images, hit_gradients):
    """Write the gradients of each hit of the listed tiles in [start, stop), columns as DIFFERENTIABLE_FIELDS.

    images: (color, depth, alpha) as `composite` wrote them; d_images: their gradients.
    """
    planes, sums = np.empty(_END, np.float32), np.empty(_END_OF_SUMS, np.float32)
    for listed in range(start, stop):
        left, top = tile_corner(first_tile + listed, images[1].shape[1])
        planes[:PIXELS] = ONE
        planes[PIXELS:] = ZERO
        _read_tile(left, top, images, d_images, planes)
        hit = offsets[listed]
        while hit < offsets[listed + 1] and has_light_left(hit - offsets[listed], planes):
            _blend_backward(splats[splat_of_hit[hit]], left, top, planes, sums, hit_gradients[hit])
            hit += 1
        hit_gradients[hit : offsets[listed + 1]] = ZERO


@compiled
def _read_tile(left, top, images, d_images, planes):
    """Load the gradients of a tile's pixels.

    As depth = sum(w z) / alpha, a weight w_i receives
        dL/dw_i = d_color . color_i + d_depth / alpha * z_i + (d_alpha - d_depth * depth / alpha).
    In the sum over the splats of w_i * dL/dw_i the two parts of depth cancel. The background is the last splat.
    """
    color, depth, alpha = images
    d_color, d_depth, d_alpha = d_images
    for row in range(min(TILE_SIZE, alpha.shape[0] - top)):
        for column in range(min(TILE_SIZE, alpha.shape[1] - left)):
            pixel = np.uintp(row * TILE_SIZE + column)
            y, x = top + row, left + column
            red, green, blue, covered = d_color[0, y, x], d_color[1, y, x], d_color[2, y, x], alpha[y, x]
            per_depth = d_depth[y, x] / covered if covered > ZERO else ZERO
            planes[_BEHIND + pixel] = (
                red * color[0, y, x] + green * color[1, y, x] + blue * color[2, y, x] + d_alpha[y, x] * covered
            )
            planes[_D_RED + pixel], planes[_D_GREEN + pixel], planes[_D_BLUE + pixel] = red, green, blue
            planes[_D_DEPTH + pixel] = per_depth
            planes[_D_ALPHA + pixel] = d_alpha[y, x] - per_depth * depth[y, x]


@compiled
def _blend_backward(splat, left, top, planes, sums, gradient):
    """Write the gradient of one splat in this tile, and update the planes for the next splat.

    With T the transmittance in front of the splat, dL/d(alpha) = T dL/dw - BEHIND / (1 - alpha).
    """
    centre_x = splat.x - np.float32(left) - HALF
    centre_y = splat.y - np.float32(top) - HALF
    half_xx, xy, half_yy = HALF * splat.conic_xx, splat.conic_xy, HALF * splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    first_row, stop_row = row_range(centre_y, splat.radius_y)
    sums[:] = ZERO
    for row in range(first_row, stop_row):
        dy = np.float32(np.int32(row)) - centre_y
        for column in range(SIDE):
            pixel = row * SIDE + column
            dx = np.float32(np.int32(column)) - centre_x
            exponent = half_xx * dx * dx + xy * dy * dx + half_yy * dy * dy
            transmittance = planes[_TRANSMITTANCE + pixel]
            unclamped = opacity * falloff(exponent)
            alpha = min(ALPHA_MAX, unclamped)
            alpha = alpha if exponent <= cutoff and transmittance >= TRANSMITTANCE_MIN else ZERO
            weight = alpha * transmittance
            planes[_TRANSMITTANCE + pixel] = transmittance - weight
            d_red, d_green, d_blue = planes[_D_RED + pixel], planes[_D_GREEN + pixel], planes[_D_BLUE + pixel]
            d_depth = planes[_D_DEPTH + pixel]
            d_weight = red * d_red + green * d_green + blue * d_blue + depth * d_depth + planes[_D_ALPHA + pixel]
            behind = planes[_BEHIND + pixel] - weight * d_weight
            planes[_BEHIND + pixel] = behind
            d_alpha = transmittance * d_weight - behind / (ONE - alpha)
            fall = d_alpha * unclamped if alpha > ZERO and unclamped < ALPHA_MAX else ZERO
            sums[_RED + column] += weight * d_red
            sums[_GREEN + column] += weight * d_green
            sums[_BLUE + column] += weight * d_blue
            sums[_DEPTH + column] += weight * d_depth
            sums[_FALL + column] += fall
            sums[_FALL_Y + column] += fall * dy
            sums[_FALL_YY + column] += fall * dy * dy
    sum_red, sum_green, sum_blue, sum_depth, sum_fall = ZERO, ZERO, ZERO, ZERO, ZERO
    sum_x, sum_y, sum_xx, sum_xy, sum_yy = ZERO, ZERO, ZERO, ZERO, ZERO
    for column in range(SIDE):
        dx = np.float32(np.int32(column)) - centre_x
        fall, fall_y = sums[_FALL + column], sums[_FALL_Y + column]
        sum_red += sums[_RED + column]
        sum_green += sums[_GREEN + column]
        sum_blue += sums[_BLUE + column]
        sum_depth += sums[_DEPTH + column]
        sum_fall += fall
        sum_x += fall * dx
        sum_y += fall_y
        sum_xx += fall * dx * dx
        sum_xy += fall_y * dx
        sum_yy += sums[_FALL_YY + column]
    # alpha decreases with the exponent (xx dx^2 + yy dy^2) / 2 + xy dx dy; dx and dy decrease as the centre increases.
    gradient[0] = splat.conic_xx * sum_x + xy * sum_y
    gradient[1] = xy * sum_x + splat.conic_yy * sum_y
    gradient[2], gradient[3], gradient[4] = -HALF * sum_xx, -sum_xy, -HALF * sum_yy
    gradient[5] = sum_fall / opacity
    gradient[6], gradient[7], gradient[8], gradient[9] = sum_red, sum_green, sum_blue, sum_depth
