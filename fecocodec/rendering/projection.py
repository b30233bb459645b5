# mypy: allow-untyped-defs
"""EWA projection of 3D Gaussians to splats through a pinhole camera.

Zwicker et al., "EWA Volume Splatting", 2001, in the form of Kerbl et al., "3D Gaussian Splatting", 2023: the
covariance is mapped by the camera's Jacobian J at the mean, Sigma' = J R Sigma R^T J^T + 0.3 I. Arithmetic is float64
in registers: it is as fast here, and thin Gaussians keep their shape. Covariances in world axes, Sigma = A A^T with
the axes times their scales as columns of A, are the same for every camera, so they are computed once for all.
"""

import math

import numpy as np

from fecocodec.geometry.gaussian_arrays import ALPHA_MIN
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

_DILATION_PX2 = 0.3  # added to both variances: a splat is never much narrower than a pixel
_FIELD_MARGIN = 0.3  # J is evaluated at most this fraction of half the field of view outside the image
_LARGEST_PX, _FARTHEST = 1e9, 1e30  # beyond these, float32 arithmetic on splats could overflow


@compiled
def covariances_of(start, stop, scales, rotations, covariances):
    """Write entries xx, xy, xz, yy, yz, zz of Sigma, float64, for the Gaussians in [start, stop)."""
    for i in range(start, stop):
        unit, _ = normalised(*_quaternion(rotations, i))
        first, second, third = rotation_columns(*unit)
        a, b, c = scaled(scales[i, 0], first), scaled(scales[i, 1], second), scaled(scales[i, 2], third)
        rows = ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))
        covariances[i, 0] = dot(rows[0], rows[0])
        covariances[i, 1] = dot(rows[0], rows[1])
        covariances[i, 2] = dot(rows[0], rows[2])
        covariances[i, 3] = dot(rows[1], rows[1])
        covariances[i, 4] = dot(rows[1], rows[2])
        covariances[i, 5] = dot(rows[2], rows[2])


@compiled
def covariances_backward(start, stop, scales, rotations, d_covariances, d_scales, d_rotations):
    """Write the gradients of scales and of quaternions before their normalisation.

    d_covariances: entries of the symmetric matrix dL/d(Sigma); that of A is 2 dL/d(Sigma) A. Where all are zero, as for
    Gaussians that no camera sees, nothing is written.
    """
    for i in range(start, stop):
        xx, xy, xz = d_covariances[i, 0], d_covariances[i, 1], d_covariances[i, 2]
        yy, yz, zz = d_covariances[i, 3], d_covariances[i, 4], d_covariances[i, 5]
        if xx == 0.0 and xy == 0.0 and xz == 0.0 and yy == 0.0 and yz == 0.0 and zz == 0.0:
            continue
        unit, length = normalised(*_quaternion(rotations, i))
        axes = rotation_columns(*unit)
        twice = scaled(2.0, (xx, xy, xz)), scaled(2.0, (xy, yy, yz)), scaled(2.0, (xz, yz, zz))
        of_axes = apply(twice, axes[0]), apply(twice, axes[1]), apply(twice, axes[2])
        for k in range(3):
            d_scales[i, k] = scales[i, k] * dot(of_axes[k], axes[k])
        d_columns = (
            scaled(scales[i, 0] * float(scales[i, 0]), of_axes[0]),
            scaled(scales[i, 1] * float(scales[i, 1]), of_axes[1]),
            scaled(scales[i, 2] * float(scales[i, 2]), of_axes[2]),
        )
        dw, dx, dy, dz = rotation_columns_backward(unit[0], unit[1], unit[2], unit[3], d_columns)
        along = dw * unit[0] + dx * unit[1] + dy * unit[2] + dz * unit[3]  # radial part, without effect
        d_rotations[i, 0] = (dw - along * unit[0]) / length
        d_rotations[i, 1] = (dx - along * unit[1]) / length
        d_rotations[i, 2] = (dy - along * unit[2]) / length
        d_rotations[i, 3] = (dz - along * unit[3]) / length


@compiled
def _quaternion(rotations, i):
    return float(rotations[i, 0]), float(rotations[i, 1]), float(rotations[i, 2]), float(rotations[i, 3])


def cutoffs_of(opacities):
    """Return the exponent at which the alpha of each Gaussian is ALPHA_MIN; where there is none, NaN or infinity."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(opacities.astype(np.float64) / ALPHA_MIN)


@compiled
def project(start, stop, pinhole, means, covariances, opacities, cutoffs, splats, gaussian_of_splat):
    """Write geometry and opacity of the visible Gaussians in [start, stop), and their indices, from `start` on."""
    place = start
    for i in range(start, stop):
        point = add(apply(pinhole.rotation, (means[i, 0], means[i, 1], means[i, 2])), pinhole.translation)
        cutoff = cutoffs[i]
        # Comparisons with NaN are false, so a NaN anywhere makes the Gaussian invisible.
        if not (pinhole.near <= point[2] < _FARTHEST and 0.0 < cutoff < math.inf):
            continue
        x = pinhole.focal_x * point[0] / point[2] + pinhole.centre_x
        y = pinhole.focal_y * point[1] / point[2] + pinhole.centre_y
        row_x, row_y = _rows(pinhole, _jacobian(pinhole, point))
        xx, xy, yy, determinant = _dilated(row_x, row_y, _times(covariances, i, row_x), _times(covariances, i, row_y))
        radius_x, radius_y = math.sqrt(2.0 * cutoff * xx), math.sqrt(2.0 * cutoff * yy)
        is_on_image = -radius_x < x < pinhole.width + radius_x and -radius_y < y < pinhole.height + radius_y
        if not (is_on_image and determinant > 0.0 and radius_x < _LARGEST_PX and radius_y < _LARGEST_PX):
            continue
        splat = splats[place]
        splat.x, splat.y, splat.depth = x, y, point[2]
        splat.conic_xx, splat.conic_xy, splat.conic_yy = yy / determinant, -xy / determinant, xx / determinant
        splat.opacity, splat.cutoff = opacities[i], cutoff
        splat.radius_x, splat.radius_y = radius_x, radius_y
        gaussian_of_splat[place] = i
        place += 1


@compiled
def _times(covariances, i, a):
    """Return the product of a covariance, stored as xx, xy, xz, yy, yz, zz, with a vector."""
    xx, xy, xz = covariances[i, 0], covariances[i, 1], covariances[i, 2]
    yy, yz, zz = covariances[i, 3], covariances[i, 4], covariances[i, 5]
    return dot((xx, xy, xz), a), dot((xy, yy, yz), a), dot((xz, yz, zz), a)


@compiled
def _dilated(row_x, row_y, times_x, times_y):
    """Return entries xx, xy, yy of the covariance on the image, and its determinant; times: Sigma times the rows."""
    xx, xy, yy = dot(row_x, times_x) + _DILATION_PX2, dot(row_x, times_y), dot(row_y, times_y) + _DILATION_PX2
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
def _rows(pinhole, jacobian):
    """Return the rows (x, y) of J R."""
    xx, xz, yy, yz = jacobian
    first, second, third = pinhole.rotation
    return add(scaled(xx, first), scaled(xz, third)), add(scaled(yy, second), scaled(yz, third))


@compiled
def project_backward(
    start, stop, pinhole, means, covariances, gaussian_of_splat, gradients, d_means, d_covariances, d_opacities
):
    """Add to d_* the gradients that come from the splats (columns DIFFERENTIABLE_FIELDS, without colours).

    d_covariances: entries of the symmetric matrix dL/d(Sigma), in the order of the covariances.
    """
    for splat in range(start, stop):
        i = gaussian_of_splat[splat]
        d_x, d_y, d_depth = gradients[splat, 0], gradients[splat, 1], gradients[splat, 9]
        d_opacities[i] += gradients[splat, 5]
        point = add(apply(pinhole.rotation, (means[i, 0], means[i, 1], means[i, 2])), pinhole.translation)
        jacobian = _jacobian(pinhole, point)
        row_x, row_y = _rows(pinhole, jacobian)
        times_x, times_y = _times(covariances, i, row_x), _times(covariances, i, row_y)
        of_conic = (gradients[splat, 2], gradients[splat, 3], gradients[splat, 4])
        d_xx, d_xy, d_yy = _conic_backward(_dilated(row_x, row_y, times_x, times_y), of_conic)
        d_row_x = scaled(2.0, add(scaled(d_xx, times_x), scaled(d_xy, times_y)))
        d_row_y = scaled(2.0, add(scaled(d_xy, times_x), scaled(d_yy, times_y)))
        d_mean = apply_transposed(
            pinhole.rotation, _point_backward(pinhole, point, jacobian, d_row_x, d_row_y, d_x, d_y, d_depth)
        )
        for k in range(3):
            d_means[i, k] += d_mean[k]
        # dL/d(Sigma) is the outer product A^T D A of the rows A and the gradient D of the covariance on the image.
        of_x, of_y = add(scaled(d_xx, row_x), scaled(d_xy, row_y)), add(scaled(d_xy, row_x), scaled(d_yy, row_y))
        d_covariances[i, 0] += row_x[0] * of_x[0] + row_y[0] * of_y[0]
        d_covariances[i, 1] += row_x[0] * of_x[1] + row_y[0] * of_y[1]
        d_covariances[i, 2] += row_x[0] * of_x[2] + row_y[0] * of_y[2]
        d_covariances[i, 3] += row_x[1] * of_x[1] + row_y[1] * of_y[1]
        d_covariances[i, 4] += row_x[1] * of_x[2] + row_y[1] * of_y[2]
        d_covariances[i, 5] += row_x[2] * of_x[2] + row_y[2] * of_y[2]


@compiled
def _conic_backward(dilated, of_conic):
    """Return the gradient of the covariance C on the image from that of K = C^-1: dC = -K dK K."""
    xx, xy, yy, determinant = dilated
    d_conic_xx, d_conic_xy, d_conic_yy = of_conic
    k_xx, k_xy, k_yy = yy / determinant, -xy / determinant, xx / determinant
    half_xy = 0.5 * d_conic_xy
    left_xx, left_xy = k_xx * d_conic_xx + k_xy * half_xy, k_xx * half_xy + k_xy * d_conic_yy
    left_yx, left_yy = k_xy * d_conic_xx + k_yy * half_xy, k_xy * half_xy + k_yy * d_conic_yy
    return (
        -(left_xx * k_xx + left_xy * k_xy),
        -(left_xx * k_xy + left_xy * k_yy),
        -(left_yx * k_xy + left_yy * k_yy),
    )


@compiled
def _point_backward(pinhole, point, jacobian, d_row_x, d_row_y, d_x, d_y, d_depth):
    """Gradient of the mean in camera axes, through its position on the image, the Jacobian and its depth."""
    x, y, z = point
    xx, xz, yy, yz = jacobian
    first, second, third = pinhole.rotation
    d_xx, d_xz, d_yy, d_yz = dot(d_row_x, first), dot(d_row_x, third), dot(d_row_y, second), dot(d_row_y, third)
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
