"""Moment matching: replace groups of Gaussians by one each. NumPy only.

The Gaussian of a group has the mean, covariance and colour of the mixture of its members, which count by what is
visible of them. The spread of their centres along the ray is left out: members lie at different depths on a surface
that is not as thick. Its opacity preserves the integral of optical depth over the image. For a Gaussian of opacity o
and projected area A (the product of its standard deviations), the integral of -ln(1 - o exp(-r^2 / 2)) is
2 pi A Li2(o), where Li2 is the dilogarithm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int64, Shaped

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


_STEPS = 1024
_OPACITIES = np.linspace(0.0, 1.0, _STEPS + 1)
_DILOGARITHMS = np.sum([_OPACITIES**k / k**2 for k in range(1, 1001)], axis=0)  # within 1e-3 at 1, its slowest place
_VALUES = _DILOGARITHMS.astype(np.float32)
_DIFFERENCES = np.diff(_VALUES, append=_VALUES[-1:])
LARGEST_OPACITY = 0.8
_LARGEST_MASS = np.float32(np.interp(LARGEST_OPACITY, _OPACITIES, _DILOGARITHMS))  # per projected area

Fields = tuple[np.ndarray, ...]
"""Means [n 3], scales [n 3], rotations [n 4], opacities [n], harmonics [n d_sh 3] of Gaussians, in float32."""


@dataclass(frozen=True)
class Mixture:
    """Gaussians of one view. eye: centre of its camera, in the frame of the means.

    masses: Li2(opacity) times projected area in cells of the grid; 0 for Gaussians that are absent. weights: the part
    of them that is visible. cells_per_steradian: of the view's grid.
    """

    fields: Fields
    eye: Float32[np.ndarray, " 3"]
    masses: Float32[np.ndarray, " n"]
    weights: Float32[np.ndarray, " n"]
    cells_per_steradian: np.float32


def dilogarithm(opacities: Float32[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
    """Return Li2 of values in [0, 1], by linear interpolation."""
    places = np.float32(_STEPS) * opacities
    below = places.astype(np.intp)
    return _VALUES[below] + (places - below.astype(np.float32)) * _DIFFERENCES[below]


def projected_areas(
    rays: Float32[np.ndarray, "n 3"], covariances: Float32[np.ndarray, "6 n"], cells_per_steradian: np.float32
) -> Float32[np.ndarray, " n"]:
    """Return the product of the two standard deviations as the eye sees them, in cells of the grid.

    rays: from the eye to the means. For the covariance C along the unit ray r it is sqrt(r^T adj(C) r) / distance^2 in
    steradians.
    """
    squared = np.maximum(np.einsum("ni,ni->n", rays, rays), _TINY)
    return cells_per_steradian * np.sqrt(np.maximum(adjugate_form(covariances, rays), 0.0) / squared) / squared


def merged_groups(mixture: Mixture, heads: Int64[np.ndarray, " n"]) -> tuple[Int64[np.ndarray, " group"], Fields]:
    """Return the heads of groups of two or more, and the Gaussians that replace them. heads: see `group`.

    If the opacity would exceed LARGEST_OPACITY, the covariance is enlarged instead, because the members cover more of
    the image than the spread of their centres.
    """
    members = np.flatnonzero(np.bincount(heads, minlength=len(heads))[heads] > 1)
    members = members[np.argsort(heads[members], kind="stable")]
    found, starts, sizes = np.unique(heads[members], return_index=True, return_counts=True)

    def summed(values: Shaped[np.ndarray, "member *shape"]) -> Shaped[np.ndarray, "group *shape"]:
        return np.add.reduceat(values, starts, axis=0) if len(starts) else values

    means, scales, rotations, _, harmonics = (field.take(members, axis=0) for field in mixture.fields)
    weights = mixture.weights.take(members)
    share = weights / np.repeat(summed(weights), sizes)
    centres = summed(share[:, None] * means)
    rays = centres - mixture.eye
    axes = np.repeat(rays / np.sqrt(np.einsum("ni,ni->n", rays, rays) + _TINY)[:, None], sizes, axis=0)
    offsets = means - np.repeat(centres, sizes, axis=0)
    offsets -= np.einsum("ni,ni->n", offsets, axes)[:, None] * axes
    x, y, z = offsets.T
    spread = from_axes(scales, rotations) + np.stack((x * x, x * y, x * z, y * y, y * z, z * z))
    covariances = summed((share * spread).T).T
    areas = projected_areas(rays, covariances, mixture.cells_per_steradian)
    masses = summed(mixture.masses[members])
    growth = np.maximum(masses / np.maximum(_LARGEST_MASS * areas, _TINY), np.float32(1.0))
    opacities = np.interp(masses / np.maximum(growth * areas, _TINY), _DILOGARITHMS, _OPACITIES)
    shapes = to_axes(growth * covariances)
    return found, (centres, *shapes, opacities.astype(np.float32), summed(share[:, None, None] * harmonics))
