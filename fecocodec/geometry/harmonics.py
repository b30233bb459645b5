"""Rotation of real spherical harmonics of degrees 1 and 2, in the order and with the signs of 3DGS."""

from typing import Any

import numpy as np
from einops import einsum

# Up to a factor for each degree, basis function k at a unit direction d is LINEAR[k] . d + d^T QUADRATIC[k] d.
LINEAR, QUADRATIC = np.zeros((8, 3)), np.zeros((8, 3, 3))
LINEAR[[0, 1, 2], [1, 2, 0]] = -1.0, 1.0, -1.0
QUADRATIC[[3, 4, 6], [0, 1, 0], [1, 2, 2]] = np.sqrt(0.5) * np.array([1.0, -1.0, -1.0])
QUADRATIC += QUADRATIC.transpose(0, 2, 1)
QUADRATIC[5], QUADRATIC[7] = np.diag([-1.0, -1.0, 2.0]) / np.sqrt(6.0), np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0)


def rotated_harmonics(higher: Any, rotation: Any, linear: Any = LINEAR, quadratic: Any = QUADRATIC) -> Any:
    """Return coefficients whose colour in each direction `rotation @ d` is the former colour in the direction d.

    All arguments are NumPy arrays, or all are tensors. higher: those above degree 0, [*batch n 3 rgb] for degree 1 or
    [*batch n 8 rgb] for degree 2. rotation: [*batch 3 3]. linear, quadratic: LINEAR and QUADRATIC.
    """
    matrix = einsum(linear, rotation, linear, "k i, ... i j, l j -> ... k l")
    matrix += einsum(quadratic, rotation, rotation, quadratic, "k i j, ... i m, ... j n, l m n -> ... k l")
    count = higher.shape[-2]
    return einsum(matrix[..., :count, :count], higher, "... k l, ... n l rgb -> ... n k rgb")
