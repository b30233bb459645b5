# mypy: allow-untyped-defs
"""EWA projection of 3D Gaussians to splats through a pinhole camera.

Zwicker et al., "EWA Volume Splatting", 2001, in the form of Kerbl et al., "3D Gaussian Splatting", 2023: the
covariance is mapped by the camera's Jacobian J at the mean, Sigma' = J R Sigma R^T J^T + 0.3 I. Arithmetic is float64
in registers: it is as fast here, and thin Gaussians keep their shape.
"""

import math

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.small_matrices import add, apply, dot, normalised, rotation_columns
from fecocodec.rendering.splats import ALPHA_MIN

_DILATION_PX2 = 0.3  # added to both variances: a splat is never much narrower than a pixel
_FIELD_MARGIN = 0.3  # J is evaluated at most this fraction of half the field of view outside the image
_LARGEST_PX, _FARTHEST = 1e9, 1e30  # beyond these, float32 arithmetic on splats could overflow


@compiled
def project(start, stop, pinhole, means, scales, rotations, opacities, splats):
    """Write geometry and opacity of splats[start:stop]; an invisible Gaussian gets radius 0."""
    for i in range(start, stop):
        splats[i].radius_x = 0.0
        splats[i].radius_y = 0.0
        point = add(apply(pinhole.rotation, (means[i, 0], means[i, 1], means[i, 2])), pinhole.translation)
        opacity = float(opacities[i])
        if not (pinhole.near <= point[2] < _FARTHEST and ALPHA_MIN < opacity < math.inf):
            continue
        unit, _ = normalised(*quaternion(rotations, i))
        (row_x, row_y), _, _ = projected_axes(pinhole, point, unit, (scales[i, 0], scales[i, 1], scales[i, 2]))
        xx, xy, yy, determinant = dilated_covariance(row_x, row_y)
        cutoff = math.log(opacity / ALPHA_MIN)
        radius_x, radius_y = math.sqrt(2.0 * cutoff * xx), math.sqrt(2.0 * cutoff * yy)
        x = pinhole.focal_x * point[0] / point[2] + pinhole.centre_x
        y = pinhole.focal_y * point[1] / point[2] + pinhole.centre_y
        is_on_image = -radius_x < x < pinhole.width + radius_x and -radius_y < y < pinhole.height + radius_y
        # Comparisons with NaN are false, so a NaN anywhere makes the Gaussian invisible.
        if not (is_on_image and determinant > 0.0 and radius_x < _LARGEST_PX and radius_y < _LARGEST_PX):
            continue
        splat = splats[i]
        splat.x, splat.y, splat.depth = x, y, point[2]
        splat.conic_xx, splat.conic_xy, splat.conic_yy = yy / determinant, -xy / determinant, xx / determinant
        splat.opacity, splat.cutoff = opacity, cutoff
        splat.radius_x, splat.radius_y = radius_x, radius_y


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
