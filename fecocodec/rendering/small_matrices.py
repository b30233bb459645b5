# mypy: allow-untyped-defs
"""3x3 algebra on tuples, which numba keeps in registers; small arrays would be allocated on the heap."""

import math

from fecocodec.kernels.compilation import compiled


@compiled
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def scaled(factor, a):
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def apply(m, a):
    """m a"""
    return dot(m[0], a), dot(m[1], a), dot(m[2], a)


@compiled
def apply_transposed(m, a):
    """m^T a"""
    return add(add(scaled(a[0], m[0]), scaled(a[1], m[1])), scaled(a[2], m[2]))


@compiled
def rotation_columns(w, x, y, z):
    """Return the columns of the rotation matrix of a unit quaternion: the rotated axes."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@compiled
def rotation_columns_backward(w, x, y, z, gradient):
    """Return the gradient of (w, x, y, z); gradient: that of the result of `rotation_columns`."""
    (g00, g10, g20), (g01, g11, g21), (g02, g12, g22) = gradient
    return (
        2.0 * (x * (g21 - g12) + y * (g02 - g20) + z * (g10 - g01)),
        2.0 * (w * (g21 - g12) + y * (g01 + g10) + z * (g02 + g20) - 2.0 * x * (g11 + g22)),
        2.0 * (w * (g02 - g20) + x * (g01 + g10) + z * (g12 + g21) - 2.0 * y * (g00 + g22)),
        2.0 * (w * (g10 - g01) + x * (g02 + g20) + y * (g12 + g21) - 2.0 * z * (g00 + g11)),
    )


@compiled
def normalised(w, x, y, z):
    """Return the unit quaternion along (w, x, y, z) and the original length; NaN where the length is 0."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length), length
