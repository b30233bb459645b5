# mypy: allow-untyped-defs
"""Gradient of `compositing`: from pixels back to the splats of each tile.

Processes splats front to back like `composite`. The contribution of the splats behind a splat is the final pixel minus
the contribution of those in front, so nothing is stored per pair of splat and pixel.
"""

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.lanes import lane_numbers, lanes, load, store, total, where
from fecocodec.rendering.compositing import (
    HALF,
    LANES,
    ONE,
    PLANE,
    PLANES_OF_TILE,
    ZERO,
    clear,
    has_light_left,
    pixel_index,
    reach,
    tile_box,
)
from fecocodec.rendering.splats import ALPHA_MAX, TRANSMITTANCE_MIN, falloff

# Offsets of the planes of a tile. BEHIND is the sum of weight * dL/d(weight) over the splats not yet processed.
_TRANSMITTANCE, _BEHIND, _D_RED, _D_GREEN, _D_BLUE, _D_DEPTH, _D_ALPHA = (np.uintp(plane) * PLANE for plane in range(7))


@compiled
def composite_backward(start, stop, first_tile, offsets, splat_of_hit, splats, images, d_images, hit_gradients):
    """Write the gradients of each hit of the listed tiles in [start, stop), columns as DIFFERENTIABLE_FIELDS.

    images: (color, depth, alpha) as `composite` wrote them; d_images: their gradients.
    """
    planes = np.empty(PLANES_OF_TILE, np.float32)
    for listed in range(start, stop):
        left, top, width, height = tile_box(first_tile + listed, images[1])
        clear(width, height, planes)
        _read_tile(left, top, width, height, images, d_images, planes)
        hit = offsets[listed]
        while hit < offsets[listed + 1] and has_light_left(hit - offsets[listed], planes):
            _blend_backward(splats[splat_of_hit[hit]], left, top, planes, hit_gradients[hit])
            hit += 1
        hit_gradients[hit : offsets[listed + 1]] = ZERO


@compiled
def _read_tile(left, top, width, height, images, d_images, planes):
    """Load the gradients of a tile's pixels.

    As depth = sum(w z) / alpha, a weight w_i receives
        dL/dw_i = d_color . color_i + d_depth / alpha * z_i + (d_alpha - d_depth * depth / alpha).
    In the sum over the splats of w_i * dL/dw_i the two parts of depth cancel. The background is the last splat.
    """
    color, depth, alpha = images
    d_color, d_depth, d_alpha = d_images
    for row in range(height):
        for column in range(width):
            pixel, y, x = pixel_index(row, column), top + row, left + column
            red, green, blue, covered = d_color[0, y, x], d_color[1, y, x], d_color[2, y, x], alpha[y, x]
            per_depth = d_depth[y, x] / covered if covered > ZERO else ZERO
            planes[_BEHIND + pixel] = (
                red * color[0, y, x] + green * color[1, y, x] + blue * color[2, y, x] + d_alpha[y, x] * covered
            )
            planes[_D_RED + pixel], planes[_D_GREEN + pixel], planes[_D_BLUE + pixel] = red, green, blue
            planes[_D_DEPTH + pixel] = per_depth
            planes[_D_ALPHA + pixel] = d_alpha[y, x] - per_depth * depth[y, x]


@compiled
def _blend_backward(splat, left, top, planes, gradient):
    """Write the gradient of one splat in this tile, and update the planes for the next splat.

    With T the transmittance in front of the splat, dL/d(alpha) = T dL/dw - BEHIND / (1 - alpha). `fall` is
    dL/d(alpha) * alpha. Sums are over rows first, then over lanes.
    """
    centre_x = splat.x - np.float32(left) - HALF
    centre_y = splat.y - np.float32(top) - HALF
    half_xx, xy, half_yy = HALF * splat.conic_xx, splat.conic_xy, HALF * splat.conic_yy
    opacity, cutoff = splat.opacity, splat.cutoff
    red, green, blue, depth = splat.red, splat.green, splat.blue, splat.depth
    first_row, stop_row = reach(centre_y, splat.radius_y)
    column, stop_column = reach(centre_x, splat.radius_x)
    red_sum, green_sum, blue_sum, depth_sum, fall_sum = ZERO, ZERO, ZERO, ZERO, ZERO
    x_sum, y_sum, xx_sum, xy_sum, yy_sum = ZERO, ZERO, ZERO, ZERO, ZERO
    while column < stop_column:
        dx = lane_numbers() - (centre_x - np.float32(np.int32(column)))
        of_x, of_xy = half_xx * dx * dx, xy * dx
        reds, greens, blues, depths = lanes(ZERO), lanes(ZERO), lanes(ZERO), lanes(ZERO)
        falls, falls_y, falls_yy = lanes(ZERO), lanes(ZERO), lanes(ZERO)
        for row in range(first_row, stop_row):
            pixel = pixel_index(row, column)
            dy = np.float32(np.int32(row)) - centre_y
            exponent = of_x + of_xy * dy + half_yy * dy * dy
            transmittance = load(planes, _TRANSMITTANCE + pixel)
            unclamped = opacity * falloff(exponent)
            is_drawn = (exponent <= cutoff) & (transmittance >= TRANSMITTANCE_MIN)
            alpha = where(is_drawn, min(unclamped, ALPHA_MAX), ZERO)
            weight = alpha * transmittance
            store(planes, _TRANSMITTANCE + pixel, transmittance - weight)
            d_red, d_green = load(planes, _D_RED + pixel), load(planes, _D_GREEN + pixel)
            d_blue, d_depth = load(planes, _D_BLUE + pixel), load(planes, _D_DEPTH + pixel)
            d_weight = red * d_red + green * d_green + blue * d_blue + depth * d_depth + load(planes, _D_ALPHA + pixel)
            behind = load(planes, _BEHIND + pixel) - weight * d_weight
            store(planes, _BEHIND + pixel, behind)
            d_alpha = transmittance * d_weight - behind / (ONE - alpha)
            fall = where(is_drawn & (unclamped < ALPHA_MAX), d_alpha * alpha, ZERO)
            reds += weight * d_red
            greens += weight * d_green
            blues += weight * d_blue
            depths += weight * d_depth
            falls += fall
            falls_y += fall * dy
            falls_yy += fall * (dy * dy)
        red_sum += total(reds)
        green_sum += total(greens)
        blue_sum += total(blues)
        depth_sum += total(depths)
        fall_sum += total(falls)
        x_sum += total(falls * dx)
        y_sum += total(falls_y)
        xx_sum += total(falls * dx * dx)
        xy_sum += total(falls_y * dx)
        yy_sum += total(falls_yy)
        column += LANES
    # alpha decreases with the exponent (xx dx^2 + yy dy^2) / 2 + xy dx dy; dx and dy decrease as the centre increases.
    gradient[0] = splat.conic_xx * x_sum + xy * y_sum
    gradient[1] = xy * x_sum + splat.conic_yy * y_sum
    gradient[2], gradient[3], gradient[4] = -HALF * xx_sum, -xy_sum, -HALF * yy_sum
    gradient[5] = fall_sum / opacity
    gradient[6], gradient[7], gradient[8], gradient[9] = red_sum, green_sum, blue_sum, depth_sum
