# mypy: allow-untyped-defs
"""Covariances of Gaussians in world axes, Sigma = A A^T, where the columns of A are the axes times their scales.

They are the same for every camera, so they are computed once for all.
"""

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.small_matrices import (
    apply,
    dot,
    normalised,
    rotation_columns,
    rotation_columns_backward,
    scaled,
)


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
        squares = (
            scales[i, 0] * float(scales[i, 0]),
            scales[i, 1] * float(scales[i, 1]),
            scales[i, 2] * float(scales[i, 2]),
        )
        for k in range(3):
            d_scales[i, k] = scales[i, k] * dot(of_axes[k], axes[k])
        d_columns = (
            scaled(squares[0], of_axes[0]),
            scaled(squares[1], of_axes[1]),
            scaled(squares[2], of_axes[2]),
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
