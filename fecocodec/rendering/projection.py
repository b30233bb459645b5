# mypy: allow-untyped-defs
"""EWA projection of 3D Gaussians to splats through a pinhole camera.

Zwicker et al., "EWA Volume Splatting", 2001, in the form of Kerbl et al., "3D Gaussian Splatting", 2023: the
covariance is mapped by the camera's Jacobian J at the mean, Sigma' = J R Sigma R^T J^T + 0.3 I. Arithmetic is float64
in registers: it is as fast here, and thin Gaussians keep their shape.
"""

import math

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.small_matrices import (
    add,
    apply,
    apply_transposed,
    dot,
    normalised,
    rotation_columns,
    rotation_columns_backward,
    scaled,
)
from fecocodec.rendering.splats import ALPHA_MIN

_DILATION_PX2 = 0.3  # added to both variances: a splat is never much narrower than a pixel
_FIELD_MARGIN = 0.3  # J is evaluated at most this fraction of half the field of view outside the image
_BALL_MARGIN = 1.01  # rotations are orthogonal up to rounding
_LARGEST_PX, _FARTHEST = 1e9, 1e30  # beyond these, float32 arithmetic on splats could overflow


@compiled
def project(start, stop, pinhole, means, scales, rotations, opacities, splats, gaussian_of_splat):
    """Write geometry and opacity of the visible Gaussians in [start, stop), and their indices, from `start` on."""
    place = start
    for i in range(start, stop):
        point = add(apply(pinhole.rotation, (means[i, 0], means[i, 1], means[i, 2])), pinhole.translation)
        opacity = float(opacities[i])
        if not (pinhole.near <= point[2] < _FARTHEST and ALPHA_MIN < opacity < math.inf):
            continue
        cutoff = math.log(opacity / ALPHA_MIN)
        x = pinhole.focal_x * point[0] / point[2] + pinhole.centre_x
        y = pinhole.focal_y * point[1] / point[2] + pinhole.centre_y
        scale = (scales[i, 0], scales[i, 1], scales[i, 2])
        if _is_outside(pinhole, point, scale, cutoff, x, y):
            continue
        unit, _ = normalised(*quaternion(rotations, i))
        (row_x, row_y), _, _ = projected_axes(pinhole, point, unit, scale)
        xx, xy, yy, determinant = dilated_covariance(row_x, row_y)
        radius_x, radius_y = math.sqrt(2.0 * cutoff * xx), math.sqrt(2.0 * cutoff * yy)
        is_on_image = -radius_x < x < pinhole.width + radius_x and -radius_y < y < pinhole.height + radius_y
        # Comparisons with NaN are false, so a NaN anywhere makes the Gaussian invisible.
        if not (is_on_image and determinant > 0.0 and radius_x < _LARGEST_PX and radius_y < _LARGEST_PX):
            continue
        splat = splats[place]
        splat.x, splat.y, splat.depth = x, y, point[2]
        splat.conic_xx, splat.conic_xy, splat.conic_yy = yy / determinant, -xy / determinant, xx / determinant
        splat.opacity, splat.cutoff = opacity, cutoff
        splat.radius_x, splat.radius_y = radius_x, radius_y
        gaussian_of_splat[place] = i
        place += 1


@compiled
def _is_outside(pinhole, point, scale, cutoff, x, y):
    """Return True if a ball with the Gaussian's largest scale is outside the image; this needs no rotation."""
    largest = max(abs(scale[0]), abs(scale[1]), abs(scale[2]))
    xx, xz, yy, yz = _jacobian(pinhole, point)
    square = _BALL_MARGIN * float(largest) * float(largest)
    radius_x = math.sqrt(2.0 * cutoff * (square * (xx * xx + xz * xz) + _DILATION_PX2))
    radius_y = math.sqrt(2.0 * cutoff * (square * (yy * yy + yz * yz) + _DILATION_PX2))
    return (
        x < -radius_x or x > pinhole.width + radius_x or y < -radius_y or y > pinhole.height + radius_y
    )  # false for NaN


@compiled
def quaternion(rotations, i):
    return float(rotations[i, 0]), float(rotations[i, 1]), float(rotations[i, 2]), float(rotations[i, 3])


@compiled
def dilated_covariance(row_x, row_y):
    """Return entries xx, xy, yy of U U^T + 0.3 I, where U has these rows, and its determinant."""
    xx, xy, yy = dot(row_x, row_x) + _DILATION_PX2, dot(row_x, row_y), dot(row_y, row_y) + _DILATION_PX2
    return xx, xy, yy, xx * yy - xy * xy


@compiled
def slope_limits(focal, centre, size):
    """Return the range of x / z (or y / z) in which the Jacobian is evaluated at the mean itself."""
    margin = _FIELD_MARGIN * 0.5 * size / focal
    return -(centre / focal + margin), (size - centre) / focal + margin


@compiled
def _jacobian(pinhole, point):
    """Return the non-zero entries of d(x_px, y_px) / d(point): (dx/dX, dx/dZ, dy/dY, dy/dZ)."""
    low_x, high_x = slope_limits(pinhole.focal_x, pinhole.centre_x, pinhole.width)
    low_y, high_y = slope_limits(pinhole.focal_y, pinhole.centre_y, pinhole.height)
    over_x, over_y = pinhole.focal_x / point[2], pinhole.focal_y / point[2]
    slope_x = min(max(point[0] / point[2], low_x), high_x)
    slope_y = min(max(point[1] / point[2], low_y), high_y)
    return over_x, -over_x * slope_x, over_y, -over_y * slope_y


@compiled
def projected_axes(pinhole, point, unit, scale):
    """Project the Gaussian's axes, one standard deviation long, to the image.

    Returns the two rows (x, y) of J R R_g S, one column per axis; the unit axes in the camera frame; and J.
    """
    columns = rotation_columns(*unit)
    axes = (
        apply(pinhole.rotation, columns[0]),
        apply(pinhole.rotation, columns[1]),
        apply(pinhole.rotation, columns[2]),
    )
    xx, xz, yy, yz = jacobian = _jacobian(pinhole, point)
    row_x = (
        scale[0] * (xx * axes[0][0] + xz * axes[0][2]),
        scale[1] * (xx * axes[1][0] + xz * axes[1][2]),
        scale[2] * (xx * axes[2][0] + xz * axes[2][2]),
    )
    row_y = (
        scale[0] * (yy * axes[0][1] + yz * axes[0][2]),
        scale[1] * (yy * axes[1][1] + yz * axes[1][2]),
        scale[2] * (yy * axes[2][1] + yz * axes[2][2]),
    )
    return (row_x, row_y), axes, jacobian


@compiled
def project_backward(
    start,
    stop,
    pinhole,
    means,
    scales,
    rotations,
    gaussian_of_splat,
    gradients,
    d_means,
    d_scales,
    d_rotations,
    d_opacities,
):
    """Add to d_* the gradients that come from the splats (columns DIFFERENTIABLE_FIELDS, without colours)."""
    for splat in range(start, stop):
        i = gaussian_of_splat[splat]
        d_x, d_y, d_depth = gradients[splat, 0], gradients[splat, 1], gradients[splat, 9]
        d_opacities[i] += gradients[splat, 5]
        point = add(apply(pinhole.rotation, (means[i, 0], means[i, 1], means[i, 2])), pinhole.translation)
        scale = (scales[i, 0], scales[i, 1], scales[i, 2])
        unit, length = normalised(*quaternion(rotations, i))
        (row_x, row_y), axes, jacobian = projected_axes(pinhole, point, unit, scale)
        d_row_x, d_row_y = _conic_backward(row_x, row_y, gradients[splat, 2], gradients[splat, 3], gradients[splat, 4])
        d_point = _point_backward(pinhole, point, jacobian, axes, scale, d_row_x, d_row_y, d_x, d_y, d_depth)
        d_mean = apply_transposed(pinhole.rotation, d_point)
        d_scale, d_rotation = _axes_backward(pinhole, unit, length, axes, jacobian, scale, d_row_x, d_row_y)
        for k in range(3):
            d_means[i, k] += d_mean[k]
            d_scales[i, k] += d_scale[k]
        for k in range(4):
            d_rotations[i, k] += d_rotation[k]


@compiled
def _conic_backward(row_x, row_y, d_conic_xx, d_conic_xy, d_conic_yy):
    """Return the gradient of the rows U of C = U U^T + 0.3 I from that of K = C^-1: dC = -K dK K, dU = 2 dC U."""
    xx, xy, yy, determinant = dilated_covariance(row_x, row_y)
    k_xx, k_xy, k_yy = yy / determinant, -xy / determinant, xx / determinant
    half_xy = 0.5 * d_conic_xy
    left_xx, left_xy = k_xx * d_conic_xx + k_xy * half_xy, k_xx * half_xy + k_xy * d_conic_yy
    left_yx, left_yy = k_xy * d_conic_xx + k_yy * half_xy, k_xy * half_xy + k_yy * d_conic_yy
    d_xx = -(left_xx * k_xx + left_xy * k_xy)
    d_xy = -(left_xx * k_xy + left_xy * k_yy)
    d_yy = -(left_yx * k_xy + left_yy * k_yy)
    return (
        scaled(2.0, add(scaled(d_xx, row_x), scaled(d_xy, row_y))),
        scaled(2.0, add(scaled(d_xy, row_x), scaled(d_yy, row_y))),
    )


@compiled
def _point_backward(pinhole, point, jacobian, axes, scale, d_row_x, d_row_y, d_x, d_y, d_depth):
    """Gradient of the mean in camera axes, through its position on the image, the Jacobian and its depth."""
    x, y, z = point
    xx, xz, yy, yz = jacobian
    d_xx, d_xz, d_yy, d_yz = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        d_xx += d_row_x[k] * scale[k] * axes[k][0]
        d_xz += d_row_x[k] * scale[k] * axes[k][2]
        d_yy += d_row_y[k] * scale[k] * axes[k][1]
        d_yz += d_row_y[k] * scale[k] * axes[k][2]
    low_x, high_x = slope_limits(pinhole.focal_x, pinhole.centre_x, pinhole.width)
    low_y, high_y = slope_limits(pinhole.focal_y, pinhole.centre_y, pinhole.height)
    # The slope entries of J are -focal * slope / z; inside the limits, slope = x / z depends on the mean.
    d_slope_x = -xx * d_xz if low_x < x / z < high_x else 0.0
    d_slope_y = -yy * d_yz if low_y < y / z < high_y else 0.0
    d_slope_x += pinhole.focal_x * d_x
    d_slope_y += pinhole.focal_y * d_y
    d_inside_jacobian = -(d_xx * xx + d_xz * xz + d_yy * yy + d_yz * yz) / z  # all of J is proportional to 1 / z
    return (
        d_slope_x / z,
        d_slope_y / z,
        d_depth + d_inside_jacobian - (d_slope_x * x + d_slope_y * y) / (z * z),
    )


@compiled
def _axes_backward(pinhole, unit, length, axes, jacobian, scale, d_row_x, d_row_y):
    """Gradients of the scales and of the quaternion before its normalisation."""
    xx, xz, yy, yz = jacobian
    # Per axis k, the gradient of the scaled axis in camera axes is J^T times the gradient of its image.
    d_axis_0 = (xx * d_row_x[0], yy * d_row_y[0], xz * d_row_x[0] + yz * d_row_y[0])
    d_axis_1 = (xx * d_row_x[1], yy * d_row_y[1], xz * d_row_x[1] + yz * d_row_y[1])
    d_axis_2 = (xx * d_row_x[2], yy * d_row_y[2], xz * d_row_x[2] + yz * d_row_y[2])
    d_scale = (dot(d_axis_0, axes[0]), dot(d_axis_1, axes[1]), dot(d_axis_2, axes[2]))
    d_columns = (
        apply_transposed(pinhole.rotation, scaled(scale[0], d_axis_0)),
        apply_transposed(pinhole.rotation, scaled(scale[1], d_axis_1)),
        apply_transposed(pinhole.rotation, scaled(scale[2], d_axis_2)),
    )
    dw, dx, dy, dz = rotation_columns_backward(unit[0], unit[1], unit[2], unit[3], d_columns)
    along = dw * unit[0] + dx * unit[1] + dy * unit[2] + dz * unit[3]  # radial part, without effect
    return d_scale, (
        (dw - along * unit[0]) / length,
        (dx - along * unit[1]) / length,
        (dy - along * unit[2]) / length,
        (dz - along * unit[3]) / length,
    )
