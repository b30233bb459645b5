"""Moment matching: merge pairs of Gaussians, in place, in arrays of attributes. NumPy only.

A merged Gaussian has the mean, covariance and colour of the mixture of the two. Its opacity preserves the integral of
optical depth over the image. For a Gaussian of opacity o and projected area A (the product of its standard deviations),
the integral of -ln(1 - o exp(-r^2 / 2)) is 2 pi A Li2(o), where Li2 is the dilogarithm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64

from fecocodec.merging.symmetric_matrices import adjugate_form

_OPACITIES = np.linspace(0.0, 1.0, 1025)
_DILOGARITHMS = sum(_OPACITIES**k / k**2 for k in range(1, 1001))  # within 1e-3 at 1, where the series is slowest
LARGEST_OPACITY = 0.8
_LARGEST_MASS = np.float32(np.interp(LARGEST_OPACITY, _OPACITIES, _DILOGARITHMS))  # per projected area
_TINY = np.float32(1e-30)


@dataclass(frozen=True)
class Mixture:
    """Gaussians as arrays that `merge_pairs` changes in place; means and eyes are in one frame.

    covariances: entries xx, xy, xz, yy, yz, zz. colours: sRGB, seen from the camera of the Gaussian's own view. eyes:
    centre of that camera. cells_per_steradian: of that view's grid. masses: Li2(opacity) times projected area in grid
    cells; 0 if the Gaussian is absent or was merged into another. is_merged: True if it replaces others.
    """

    means: Float32[np.ndarray, "n 3"]
    covariances: Float32[np.ndarray, "n 6"]
    opacities: Float32[np.ndarray, " n"]
    harmonics: Float32[np.ndarray, "n d_sh 3"]
    colours: Float32[np.ndarray, "n 3"]
    eyes: Float32[np.ndarray, "n 3"]
    cells_per_steradian: Float32[np.ndarray, " n"]
    masses: Float32[np.ndarray, " n"]
    is_merged: Bool[np.ndarray, " n"]


def dilogarithm(opacities: Float32[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
    """Return Li2 of values in [0, 1]."""
    return np.interp(opacities, _OPACITIES, _DILOGARITHMS).astype(np.float32)


def projected_areas(
    means: Float32[np.ndarray, "n 3"],
    covariances: Float32[np.ndarray, "n 6"],
    eyes: Float32[np.ndarray, "n 3"],
    cells_per_steradian: Float32[np.ndarray, " n"],
) -> Float32[np.ndarray, " n"]:
    """Return the product of the two standard deviations as the eye sees them, in grid cells.

    For the covariance C along the unit ray r it is sqrt(r^T adj(C) r) / distance^2 in steradians.
    """
    rays = means - eyes
    squared = np.maximum(np.einsum("ni,ni->n", rays, rays), _TINY)
    return cells_per_steradian * np.sqrt(np.maximum(adjugate_form(covariances, rays), 0.0) / squared) / squared


def merge_pairs(mixture: Mixture, first: Int64[np.ndarray, " pair"], second: Int64[np.ndarray, " pair"]) -> None:
    """Replace the Gaussian `first` of each pair by the merged one and set the mass of `second` to 0.

    If the merged opacity would exceed LARGEST_OPACITY, the covariance is enlarged instead, because the members cover
    more of the image than the spread of their centres. No Gaussian may be part of two pairs.
    """
    masses = mixture.masses[first] + mixture.masses[second]
    share = mixture.masses[second] / masses
    offset = mixture.means[second] - mixture.means[first]
    means = mixture.means[first] + share[:, None] * offset
    between = offset[:, [0, 0, 0, 1, 1, 2]] * offset[:, [0, 1, 2, 1, 2, 2]]
    covariances = _mixed(mixture.covariances, first, second, share) + (share * (1.0 - share))[:, None] * between
    areas = projected_areas(means, covariances, mixture.eyes[first], mixture.cells_per_steradian[first])
    growth = np.maximum(masses / np.maximum(_LARGEST_MASS * areas, _TINY), 1.0)
    opacities = np.interp(masses / np.maximum(growth * areas, _TINY), _DILOGARITHMS, _OPACITIES)
    for field in (mixture.harmonics, mixture.colours):
        field[first] = _mixed(field, first, second, share)
    mixture.means[first], mixture.covariances[first] = means, growth[:, None] * covariances
    mixture.opacities[first], mixture.masses[first] = opacities, masses
    mixture.masses[second], mixture.is_merged[first] = 0.0, True


def _mixed(
    field: Float32[np.ndarray, "n *shape"],
    first: Int64[np.ndarray, " pair"],
    second: Int64[np.ndarray, " pair"],
    share: Float32[np.ndarray, " pair"],
) -> Float32[np.ndarray, "pair *shape"]:
    share = share.reshape(-1, *[1] * (field.ndim - 1))
    return (1.0 - share) * field[first] + share * field[second]
