"""Merge similar neighbouring Gaussians by moment matching, without rendering.

Merging runs after the normative decoding process. In each cell of 2x2 Gaussians of a view's grid, the pair with the
least cost is merged, repeatedly, while the cost is at most a bound. The same is then done with cells of 4x4, whose four
members must each represent a whole 2x2 cell. The cost is that of Ward, "Hierarchical Grouping to Optimize an Objective
Function", 1963, relative to the cell.
"""

from dataclasses import dataclass

import numpy as np
from einops import rearrange
from jaxtyping import Bool, Float32, Int64, Shaped

from fecocodec.geometry.harmonics import SH_DEGREE_0, SH_DEGREE_1
from fecocodec.merging.moment_matching import Mixture, dilogarithm, merge_pairs, projected_areas
from fecocodec.merging.symmetric_matrices import from_axes, to_axes

_PAIRS = np.array([(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)])  # of the four members of a cell
_REACH = 2  # radius of the window of the local contrast, in Gaussians
_TINY = np.float32(1e-30)


@dataclass(frozen=True)
class MergingConfig:
    """Parameters of merging.

    largest_costs: bound on the cost of a merge, per level of cells (2x2, 4x4), in squared sRGB.
    contrast_weight: weight of the local contrast, the mean squared difference to the colours of the 5x5 neighbours,
    which is added to the squared difference of the two colours. Without contrast, a change of shape is invisible.
    depth_weight: relative increase of the cost per unit of difference between the log distances to the camera.
    """

    largest_costs: tuple[float, ...] = (5e-4, 1e-3)
    contrast_weight: float = 0.5
    depth_weight: float = 15.0


Fields = tuple[np.ndarray, ...]
"""Means [n 3], scales [n 3], rotations [n 4], opacities [n], harmonics [n d_sh 3] of Gaussians, in float32."""


def merged_fields(
    fields: Fields,
    is_present: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    extrinsics: Float32[np.ndarray, "view 4 4"],
    intrinsics: Float32[np.ndarray, "view 3 3"],
    config: MergingConfig,
) -> Fields:
    """Merge similar neighbours and drop the Gaussians that are not present; the order is kept.

    fields: of one scene, ordered (view, row, column); n = views * rows * columns. grid: rows and columns of a view,
    multiples of 4. is_present: False for those to drop, which may have any values. extrinsics: camera-to-world, in the
    frame of the Gaussians. intrinsics: normalised. A merged Gaussian takes the index of one of its members.
    """
    mixture = _mixture(fields, is_present, grid, extrinsics, intrinsics)
    survivors = np.arange(len(is_present)).reshape(len(extrinsics), *grid)
    contrast = _local_contrast(mixture.colours[survivors]).reshape(-1)
    is_whole = np.ones(survivors.shape, bool)
    for level, largest_cost in enumerate(config.largest_costs, start=1):
        cells = _cells(survivors)
        _agglomerate(mixture, contrast, cells[_cells(is_whole).all(axis=-1)], 4**level, largest_cost, config)
        masses = mixture.masses[cells]
        survivors = np.take_along_axis(cells, masses.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        is_whole = _cells(is_whole).all(axis=-1) & ((masses > 0.0).sum(axis=-1) == 1)
    return _emitted(fields, mixture)


def _mixture(
    fields: Fields,
    is_present: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    extrinsics: Float32[np.ndarray, "view 4 4"],
    intrinsics: Float32[np.ndarray, "view 3 3"],
) -> Mixture:
    """Return the Gaussians as arrays, zeros for those that are not present."""
    zeroed = (np.where(is_present.reshape(-1, *[1] * (x.ndim - 1)), x, np.float32(0.0)) for x in fields)
    means, scales, rotations, opacities, harmonics = zeroed
    per_view = grid[0] * grid[1]
    eyes = np.repeat(extrinsics[:, :3, 3], per_view, axis=0)
    density = np.repeat(per_view * intrinsics[:, 0, 0] * intrinsics[:, 1, 1], per_view)
    covariances = from_axes(scales, rotations)
    masses = dilogarithm(opacities) * projected_areas(means, covariances, eyes, density)
    colours = _own_colours(harmonics, means - eyes)
    is_merged = np.zeros(len(means), bool)
    return Mixture(means, covariances, opacities, harmonics, colours, eyes, density, masses, is_merged)


def _own_colours(harmonics: Float32[np.ndarray, "n d_sh 3"], rays: Float32[np.ndarray, "n 3"]) -> np.ndarray:
    """Return colours [n 3] along the rays, without clamping, for harmonics of degree 0 or 1."""
    colours = 0.5 + SH_DEGREE_0 * harmonics[:, 0]
    if harmonics.shape[1] == 1:
        return colours
    x, y, z = (SH_DEGREE_1 * rays / np.sqrt(np.einsum("ni,ni->n", rays, rays)[:, None] + _TINY)).T[..., None]
    return colours - y * harmonics[:, 1] + z * harmonics[:, 2] - x * harmonics[:, 3]


def _local_contrast(colours: Float32[np.ndarray, "view row column 3"]) -> Float32[np.ndarray, "view row column"]:
    """Return the mean squared difference between each colour and those of its neighbours, mean over channels."""
    mean, mean_square = _box_mean(colours), _box_mean(np.square(colours))
    difference = mean_square - 2.0 * colours * mean + np.square(colours)
    return np.maximum(np.einsum("vhwc->vhw", difference) / 3.0, 0.0)


def _box_mean(values: Float32[np.ndarray, "view row column 3"]) -> Float32[np.ndarray, "view row column 3"]:
    padded = np.pad(values, ((0, 0), (_REACH, _REACH), (_REACH, _REACH), (0, 0)), mode="edge")
    rows, columns = values.shape[1:3]
    width = 2 * _REACH + 1
    summed = np.add.reduce([padded[:, shift : shift + rows] for shift in range(width)])
    mean: np.ndarray = np.add.reduce([summed[:, :, shift : shift + columns] for shift in range(width)])
    return mean / np.float32(width**2)


def _cells(values: Shaped[np.ndarray, "view row column"]) -> Shaped[np.ndarray, "view row2 column2 4"]:
    return rearrange(values, "v (h dy) (w dx) -> v h w (dy dx)", dy=2, dx=2)


def _agglomerate(
    mixture: Mixture,
    contrast: Float32[np.ndarray, " n"],
    cells: Int64[np.ndarray, "cell 4"],
    area: int,
    largest_cost: float,
    config: MergingConfig,
) -> None:
    """Merge the pair of least cost of each cell, up to three times, while the cost is at most largest_cost.

    area: of a cell, in cells of the grid.
    """
    contrast = np.einsum("cm->c", contrast[cells]) / np.float32(4.0)
    for _ in range(3):
        costs = _pair_costs(mixture, contrast, cells, area, config)
        best = costs.argmin(axis=1)
        is_cheap = costs[np.arange(len(cells)), best] <= largest_cost
        cells, contrast, best = cells[is_cheap], contrast[is_cheap], best[is_cheap]
        pairs = np.take_along_axis(cells, _PAIRS[best], axis=1)
        merge_pairs(mixture, pairs[:, 0], pairs[:, 1])


def _pair_costs(
    mixture: Mixture,
    contrast: Float32[np.ndarray, " cell"],
    cells: Int64[np.ndarray, "cell 4"],
    area: int,
    config: MergingConfig,
) -> Float32[np.ndarray, "cell 6"]:
    """Return the cost of merging each pair, infinite if one of the pair is absent.

    The cost is m1 m2 / (m1 + m2) / sum(m) * sqrt(optical depth) * (|colour difference|^2 + weighted contrast)
    * (1 + weighted difference of log distances), where m are the masses of the cell's members.
    """
    masses, colours = mixture.masses[cells], mixture.colours[cells]
    rays = mixture.means[cells] - mixture.eyes[cells]
    logs = 0.5 * np.log(np.einsum("cmi,cmi->cm", rays, rays) + _TINY)
    total = np.einsum("cm->c", masses)
    weight = np.sqrt(2.0 * np.pi / area / np.maximum(total, _TINY))
    costs = np.full((len(cells), len(_PAIRS)), np.inf, np.float32)
    for number, (i, j) in enumerate(_PAIRS):
        product = masses[:, i] * masses[:, j]
        reduced = product / np.maximum(masses[:, i] + masses[:, j], _TINY)
        difference = colours[:, i] - colours[:, j]
        change = np.einsum("ci,ci->c", difference, difference) / 3.0 + config.contrast_weight * contrast
        apart = 1.0 + config.depth_weight * np.abs(logs[:, i] - logs[:, j])
        costs[:, number] = np.where(product > 0.0, weight * reduced * change * apart, np.inf)
    return costs


def _emitted(fields: Fields, mixture: Mixture) -> Fields:
    """Return the Gaussians with mass; the attributes of those that were not merged are unchanged."""
    survives = mixture.masses > 0.0
    changed = np.flatnonzero(mixture.is_merged & survives)
    shapes = to_axes(mixture.covariances[changed])
    replacements = (mixture.means[changed], *shapes, mixture.opacities[changed], mixture.harmonics[changed])
    copies = [field.copy() for field in fields]
    for field, values in zip(copies, replacements, strict=True):
        field[changed] = values
    return tuple(field[survives] for field in copies)
