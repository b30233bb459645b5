"""Merge alike neighbouring Gaussians of a view's grid by moment matching, without rendering.

Merging runs after the normative decoding process: `grouping` finds groups, `moment_matching` replaces them.
"""

import numpy as np
from jaxtyping import Bool, Float32

from fecocodec.geometry.gaussian_arrays import SH_DEGREE_0, SH_DEGREE_1
from fecocodec.merging.grouping import MergingConfig, Surface, group
from fecocodec.merging.moment_matching import Fields, Mixture, dilogarithm, from_axes, merged_groups, projected_areas

_REACH = 2  # radius of the window of the local contrast, in Gaussians
_VARIANCE = 1.2  # of the footprint that hides neighbours, in squared Gaussians
_LARGEST_DEPTH = np.float32(1.5)  # bound on the optical depth of one Gaussian per cell of the grid
_STEEPNESS = np.float32(1.5)  # chosen on validation scenes; the Gaussians of the other views hide too
_TINY = np.float32(1e-30)
_LEAST_WEIGHT = np.float32(1e-12)  # of a Gaussian that is present, however hidden
_LARGEST_WEIGHT = np.float32(1e15)  # of those that are grouped; products of two are finite


def local_contrast(colours: Float32[np.ndarray, "3 row column"]) -> Float32[np.ndarray, "row column"]:
    """Return the mean squared difference between each colour and those of its neighbours, mean over channels."""
    squares = np.einsum("chw,chw->hw", colours, colours)
    means = _box_mean(np.concatenate((colours, squares[None])))
    difference = means[3] - 2.0 * np.einsum("chw,chw->hw", colours, means[:3]) + squares
    return np.maximum(difference / np.float32(3.0), 0.0)


def _box_mean(values: Float32[np.ndarray, "plane row column"]) -> Float32[np.ndarray, "plane row column"]:
    padded = np.pad(values, ((0, 0), (_REACH, _REACH), (_REACH, _REACH)), mode="edge")
    rows, columns = values.shape[1:]
    width = 2 * _REACH + 1
    summed = np.add.reduce([padded[:, shift : shift + rows] for shift in range(width)])
    mean: np.ndarray = np.add.reduce([summed[:, :, shift : shift + columns] for shift in range(width)])
    return mean / np.float32(width**2)


def transmittance(
    masses: Float32[np.ndarray, "row column"], distances: Float32[np.ndarray, "row column"]
) -> Float32[np.ndarray, "row column"]:
    """Return about which share of the light of each Gaussian passes those before it, seen from its own view.

    masses: see `Mixture`. distances: to the eye, in any increasing measure. The neighbours before a Gaussian, and half
    of itself, hide it, with the same footprint for all.
    """
    depths = np.minimum(np.float32(2.0 * np.pi) * masses, _LARGEST_DEPTH)
    weights = {(y, x): np.exp(-(y * y + x * x) / (2.0 * _VARIANCE)) for y in (-1, 0, 1) for x in (-1, 0, 1)}
    share = {shift: np.float32(weight / sum(weights.values())) for shift, weight in weights.items()}
    hidden = 0.5 * share.pop((0, 0)) * depths
    near, before = np.pad(distances, 1, constant_values=np.inf), np.pad(depths, 1)
    for shift, part in share.items():
        hidden += part * _shifted(before, shift) * (_shifted(near, shift) < distances)
    return np.exp(-_STEEPNESS * hidden)


def _shifted(padded: Float32[np.ndarray, "row2 column2"], shift: tuple[int, int]) -> Float32[np.ndarray, "row column"]:
    y, x = shift
    return padded[1 + y : padded.shape[0] - 1 + y, 1 + x : padded.shape[1] - 1 + x]


def merged_fields(
    fields: Fields,
    is_present: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    extrinsics: Float32[np.ndarray, "view 4 4"],
    intrinsics: Float32[np.ndarray, "view 3 3"],
    config: MergingConfig,
) -> Fields:
    """Merge alike neighbours and drop the Gaussians that are not present; the order is kept.

    fields: of one scene, ordered (view, row, column); n = views * rows * columns. grid: rows and columns of a view,
    both even. is_present: False for those to drop, which may have any values. extrinsics: camera-to-world, in the
    frame of the Gaussians. intrinsics: normalised. A merged Gaussian takes the place of one of its members.
    """
    views = zip(*(np.split(array, len(extrinsics)) for array in (*fields, is_present)), strict=True)
    densities = grid[0] * grid[1] * intrinsics[:, 0, 0] * intrinsics[:, 1, 1]
    merged = [
        _merged_view(of_view[:-1], of_view[-1], grid, pose[:3, 3], density, config)
        for of_view, pose, density in zip(views, extrinsics, densities, strict=True)
    ]
    return tuple(map(np.concatenate, zip(*merged, strict=True)))


def _merged_view(
    fields: Fields,
    is_present: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    eye: Float32[np.ndarray, " 3"],
    cells_per_steradian: np.float32,
    config: MergingConfig,
) -> Fields:
    """Return the merged Gaussians of one view. eye: centre of its camera."""
    with np.errstate(all="ignore"):  # Gaussians that are not present may have any values
        mixture, surface = _prepared(fields, is_present, grid, eye, cells_per_steradian)
    heads = group(surface, grid, config)
    found, replacements = merged_groups(mixture, heads)
    survivors = np.flatnonzero(is_present & (heads == np.arange(len(heads))))
    kept = tuple(field.take(survivors, axis=0) for field in fields)
    for field, values in zip(kept, replacements, strict=True):
        field[np.searchsorted(survivors, found)] = values
    return kept


def _prepared(
    fields: Fields,
    is_present: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    eye: Float32[np.ndarray, " 3"],
    cells_per_steradian: np.float32,
) -> tuple[Mixture, Surface]:
    """Return the Gaussians of a view with masses and weights, and what decides which of them are grouped."""
    means, scales, rotations, opacities, harmonics = fields
    zero = np.float32(0.0)
    rays = np.where(is_present[:, None], means - eye, zero)
    logs = 0.5 * np.log(np.einsum("ni,ni->n", rays, rays) + _TINY)
    areas = projected_areas(rays, from_axes(scales, rotations), cells_per_steradian)
    masses = np.where(is_present, dilogarithm(np.where(is_present, opacities, zero)) * areas, zero)
    colours = np.where(is_present, _own_colours(harmonics, rays), zero)  # black where absent: edges have contrast
    visible = transmittance(masses.reshape(grid), logs.reshape(grid)).reshape(-1)
    weights = masses * visible + _LEAST_WEIGHT * is_present
    contrasts = local_contrast(colours.reshape(3, *grid)).reshape(-1)
    grouped = np.where(weights <= _LARGEST_WEIGHT, weights, zero)
    return Mixture(fields, eye, masses, weights, cells_per_steradian), Surface(grouped, colours, logs, contrasts)


def _own_colours(
    harmonics: Float32[np.ndarray, "n d_sh 3"], rays: Float32[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "3 n"]:
    """Return colours along the rays, without clamping, for harmonics of degree 0 or 1."""
    basis = np.full(harmonics.shape[:2], SH_DEGREE_0, np.float32)
    if harmonics.shape[1] > 1:
        directions = SH_DEGREE_1 * rays / np.sqrt(np.einsum("ni,ni->n", rays, rays) + _TINY)[:, None]
        basis[:, 1:] = directions[:, [1, 2, 0]] * np.array([-1.0, 1.0, -1.0], np.float32)
    colours: np.ndarray = 0.5 + np.einsum("nd,ndc->cn", basis, harmonics)
    return colours
