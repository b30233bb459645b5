"""Symmetric 3x3 matrices in arrays whose rows are their entries xx, xy, xz, yy, yz, zz. NumPy only."""

import numpy as np
from jaxtyping import Float, Float32

_SWEEPS = 4  # of Jacobi rotations; convergence is quadratic, 4 reach the precision of float32
_TINY = np.float32(1e-30)


def from_axes(scales: Float32[np.ndarray, "n 3"], rotations: Float32[np.ndarray, "n 4"]) -> Float32[np.ndarray, "6 n"]:
    """Return R diag(scales^2) R^T, where R is the rotation of the unit quaternion wxyz."""
    w, x, y, z = rotations.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    variances = np.square(scales).T
    entries = [
        sum(variance * a * b for variance, a, b in zip(variances, rows[i], rows[j], strict=True))
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ]
    return np.stack(entries)


def adjugate_form(matrices: Float[np.ndarray, "6 n"], vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return v^T adj(M) v."""
    xx, xy, xz, yy, yz, zz = matrices
    x, y, z = vectors.T
    diagonal = x * x * (yy * zz - yz * yz) + y * y * (xx * zz - xz * xz) + z * z * (xx * yy - xy * xy)
    mixed = x * y * (xz * yz - xy * zz) + x * z * (xy * yz - xz * yy) + y * z * (xy * xz - xx * yz)
    return diagonal + 2.0 * mixed


def to_axes(
    matrices: Float32[np.ndarray, "6 n"],
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 4"]]:
    """Return scales and unit quaternions wxyz with R diag(scales^2) R^T = M, the inverse of `from_axes`.

    Uses cyclic Jacobi rotations about the coordinate axes (Golub and Van Loan, "Matrix Computations", section 8.5) and
    multiplies their quaternions, for all matrices at once.
    """
    xx, xy, xz, yy, yz, zz = matrices
    entries = {(0, 0): xx, (0, 1): xy, (0, 2): xz, (1, 1): yy, (1, 2): yz, (2, 2): zz}
    quaternion = [np.ones_like(xx), *np.zeros((3, len(xx)), np.float32)]
    for _ in range(_SWEEPS):
        for p, q, axis in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            quaternion = _turned(quaternion, axis, _rotate(entries, p, q, axis))
    variances = np.stack([entries[i, i] for i in range(3)], axis=1)
    rotations = np.stack(quaternion, axis=1)
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return np.sqrt(np.maximum(variances, 0.0)), rotations


def _rotate(
    entries: dict[tuple[int, int], Float32[np.ndarray, " n"]], p: int, q: int, axis: int
) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """Rotate about an axis, from p towards q, so that entry pq vanishes; returns cosine and sine of half the angle.

    The angle is in [-pi/4, pi/4].
    """
    pq, pr, qr = ((min(a, b), max(a, b)) for a, b in ((p, q), (p, axis), (q, axis)))
    pp, qq, off = entries[p, p], entries[q, q], entries[pq]
    apart, twice = np.abs(pp - qq), np.where(pp < qq, -2.0, 2.0).astype(np.float32) * off
    tangent = twice / (apart + np.hypot(apart, twice) + _TINY)
    cos = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sin = tangent * cos
    shift = off * tangent
    entries[p, p], entries[q, q], entries[pq] = pp + shift, qq - shift, np.zeros_like(off)
    entries[pr], entries[qr] = cos * entries[pr] + sin * entries[qr], cos * entries[qr] - sin * entries[pr]
    half = np.sqrt(0.5 + 0.5 * cos)
    return half, 0.5 * sin / half


def _turned(
    quaternion: list[Float32[np.ndarray, " n"]],
    axis: int,
    half: tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]],
) -> list[Float32[np.ndarray, " n"]]:
    """Return the quaternion times that of a rotation about a coordinate axis. half: see `_rotate`."""
    cos, sin = half
    w, along = quaternion[0], quaternion[1 + axis]
    ahead, behind = quaternion[1 + (axis + 1) % 3], quaternion[1 + (axis + 2) % 3]
    turned = [cos * w - sin * along] * 4
    turned[1 + axis] = cos * along + sin * w
    turned[1 + (axis + 1) % 3] = cos * ahead + sin * behind
    turned[1 + (axis + 2) % 3] = cos * behind - sin * ahead
    return turned
