# mypy: allow-untyped-defs
"""View-dependent colour: real spherical harmonics up to degree 3, and their gradient.

Order and signs of the basis as in Kerbl et al., "3D Gaussian Splatting", 2023 (after Sloan, "Efficient Spherical
Harmonic Evaluation", 2013).
"""

import math

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.rendering.small_matrices import add

MAX_COEFFICIENTS = 16  # (degree + 1)^2 at degree 3

_BRIGHTEST = 1e30  # beyond this, float32 arithmetic on colours could overflow

_C0 = 0.28209479177387814
_C1 = 0.4886025119029199
_C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
_C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)


@compiled
def shade(start, stop, eye, means, harmonics, gaussian_of_splat, splats):
    """Write the colours, at least 0, of the splats in [start, stop); those whose colour is not finite get radius 0.

    eye: camera centre in the world frame.
    """
    basis = np.empty(MAX_COEFFICIENTS)
    for splat in range(start, stop):
        i = gaussian_of_splat[splat]
        direction, _ = _direction(eye, means, i)
        _evaluate(direction, harmonics.shape[1], basis)
        red, green, blue = 0.5, 0.5, 0.5
        for k in range(harmonics.shape[1]):
            red += basis[k] * harmonics[i, k, 0]
            green += basis[k] * harmonics[i, k, 1]
            blue += basis[k] * harmonics[i, k, 2]
        if not abs(red) + abs(green) + abs(blue) < _BRIGHTEST:  # also true for NaN
            splats[splat].radius_x = 0.0
            continue
        splats[splat].red, splats[splat].green, splats[splat].blue = max(red, 0.0), max(green, 0.0), max(blue, 0.0)


@compiled
def shade_backward(start, stop, eye, means, harmonics, gaussian_of_splat, splats, gradients, d_means, d_harmonics):
    """Add to d_means and d_harmonics the gradients from the colour columns of the splats' gradients."""
    basis = np.empty(MAX_COEFFICIENTS)
    slopes = np.empty((MAX_COEFFICIENTS, 3))
    for splat in range(start, stop):
        if splats[splat].radius_x == 0.0:
            continue
        i = gaussian_of_splat[splat]
        d_red = gradients[splat, 6] if splats[splat].red > 0.0 else 0.0
        d_green = gradients[splat, 7] if splats[splat].green > 0.0 else 0.0
        d_blue = gradients[splat, 8] if splats[splat].blue > 0.0 else 0.0
        direction, distance = _direction(eye, means, i)
        _evaluate(direction, harmonics.shape[1], basis)
        _differentiate(direction, harmonics.shape[1], slopes)
        d_direction = (0.0, 0.0, 0.0)
        for k in range(harmonics.shape[1]):
            d_harmonics[i, k, 0] += basis[k] * d_red
            d_harmonics[i, k, 1] += basis[k] * d_green
            d_harmonics[i, k, 2] += basis[k] * d_blue
            weight = harmonics[i, k, 0] * d_red + harmonics[i, k, 1] * d_green + harmonics[i, k, 2] * d_blue
            d_direction = add(d_direction, (weight * slopes[k, 0], weight * slopes[k, 1], weight * slopes[k, 2]))
        along = d_direction[0] * direction[0] + d_direction[1] * direction[1] + d_direction[2] * direction[2]
        for axis in range(3):
            d_means[i, axis] += (d_direction[axis] - along * direction[axis]) / distance


@compiled
def _direction(eye, means, i):
    """Return the unit vector from the eye to the mean, and their distance."""
    x, y, z = means[i, 0] - eye[0], means[i, 1] - eye[1], means[i, 2] - eye[2]
    distance = math.sqrt(x * x + y * y + z * z)
    return (x / distance, y / distance, z / distance), distance


@compiled
def _evaluate(direction, count, basis):
    """Write the first `count` basis functions at a unit direction."""
    x, y, z = direction
    basis[0] = _C0
    if count > 1:
        basis[1], basis[2], basis[3] = -_C1 * y, _C1 * z, -_C1 * x
    if count > 4:
        basis[4], basis[5] = _C2[0] * x * y, -_C2[0] * y * z
        basis[6] = _C2[1] * (2.0 * z * z - x * x - y * y)
        basis[7], basis[8] = -_C2[0] * x * z, _C2[2] * (x * x - y * y)
    if count > 9:
        basis[9] = -_C3[0] * y * (3.0 * x * x - y * y)
        basis[10] = _C3[1] * x * y * z
        basis[11] = -_C3[2] * y * (4.0 * z * z - x * x - y * y)
        basis[12] = _C3[3] * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y)
        basis[13] = -_C3[2] * x * (4.0 * z * z - x * x - y * y)
        basis[14] = _C3[4] * z * (x * x - y * y)
        basis[15] = -_C3[0] * x * (x * x - 3.0 * y * y)


@compiled
def _differentiate(direction, count, slopes):
    """Write the derivatives by x, y and z of the first `count` polynomials of `_evaluate`."""
    x, y, z = direction
    _set(slopes, 0, 1.0, 0.0, 0.0, 0.0)
    if count > 1:
        _set(slopes, 1, -_C1, 0.0, 1.0, 0.0)
        _set(slopes, 2, _C1, 0.0, 0.0, 1.0)
        _set(slopes, 3, -_C1, 1.0, 0.0, 0.0)
    if count > 4:
        _set(slopes, 4, _C2[0], y, x, 0.0)
        _set(slopes, 5, -_C2[0], 0.0, z, y)
        _set(slopes, 6, _C2[1], -2.0 * x, -2.0 * y, 4.0 * z)
        _set(slopes, 7, -_C2[0], z, 0.0, x)
        _set(slopes, 8, _C2[2], 2.0 * x, -2.0 * y, 0.0)
    if count > 9:
        _set(slopes, 9, -_C3[0], 6.0 * x * y, 3.0 * (x * x - y * y), 0.0)
        _set(slopes, 10, _C3[1], y * z, x * z, x * y)
        _set(slopes, 11, -_C3[2], -2.0 * x * y, 4.0 * z * z - x * x - 3.0 * y * y, 8.0 * y * z)
        _set(slopes, 12, _C3[3], -6.0 * x * z, -6.0 * y * z, 6.0 * z * z - 3.0 * x * x - 3.0 * y * y)
        _set(slopes, 13, -_C3[2], 4.0 * z * z - 3.0 * x * x - y * y, -2.0 * x * y, 8.0 * x * z)
        _set(slopes, 14, _C3[4], 2.0 * x * z, -2.0 * y * z, x * x - y * y)
        _set(slopes, 15, -_C3[0], 3.0 * (x * x - y * y), -6.0 * x * y, 0.0)


@compiled
def _set(slopes, k, factor, dx, dy, dz):
    slopes[k, 0], slopes[k, 1], slopes[k, 2] = factor * dx, factor * dy, factor * dz
