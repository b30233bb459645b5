"""Group alike neighbouring Gaussians of a view's grid. NumPy only.

In each cell of 2x2 Gaussians the pair with the least cost is joined, repeatedly, while the cost is at most a bound. The
same is then done in cells that are shifted by one Gaussian, with the Gaussians that stand for their members; those that
were joined there are not joined again. The cost is that of Ward, "Hierarchical Grouping to Optimize an Objective
Function", 1963.
"""

from dataclasses import dataclass

import numpy as np
from einops import rearrange
from jaxtyping import Float32, Int64

_PAIRS = np.array([(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)])  # of the four members of a cell
_JOINS = 3  # of the four members of a cell
_TINY = np.float32(1e-30)


@dataclass(frozen=True)
class MergingConfig:
    """Parameters of merging.

    largest_cost: bound on the cost of joining two Gaussians, in squared sRGB per Gaussian of the grid.
    contrast_weight: weight of the local contrast, the mean squared difference to the colours of the 5x5 neighbours,
    which is added to the squared difference of the two colours. Without contrast, a change of shape is invisible.
    depth_weight: relative increase of the cost per unit of difference between the log distances to the camera.
    """

    largest_cost: float = 4e-4
    contrast_weight: float = 0.5
    depth_weight: float = 40.0


DEFAULT_MERGING = MergingConfig()


@dataclass(frozen=True)
class Surface:
    """Gaussians of one view, ordered (row, column), as arrays that `group` changes in place.

    weights: visible masses; 0 if the Gaussian is absent or was joined to another. colours: sRGB, seen from the view.
    logs: logarithm of the distance to the eye. contrasts: see `local_contrast`.
    """

    weights: Float32[np.ndarray, " n"]
    colours: Float32[np.ndarray, "3 n"]
    logs: Float32[np.ndarray, " n"]
    contrasts: Float32[np.ndarray, " n"]


def group(surface: Surface, grid: tuple[int, int], config: MergingConfig) -> Int64[np.ndarray, " n"]:
    """Return the index of the Gaussian that stands for each, of up to 16. grid: rows and columns, even.

    The member that weighs most stands for a group.
    """
    places = np.arange(len(surface.weights)).reshape(grid)
    heads = places.ravel().copy()
    heads = _join(surface, heads, _cells(places).reshape(4, -1), config)
    around = _cells(places[1:-1, 1:-1])
    for row, column in ((0, 0), (1, 1), (0, 1), (1, 0)):  # no two of these cells touch the same cell of the first pass
        former = heads[around[:, row::2, column::2].reshape(4, -1)]
        heads = _join(surface, heads, former, config)
        surface.weights[heads[former[heads[former] != former]]] = 0.0
    return heads


def _cells(places: Int64[np.ndarray, "row column"]) -> Int64[np.ndarray, "4 row2 column2"]:
    return rearrange(places, "(h dy) (w dx) -> (dy dx) h w", dy=2, dx=2)


def _join(
    surface: Surface,
    heads: Int64[np.ndarray, " n"],
    cells: Int64[np.ndarray, "4 cell"],
    config: MergingConfig,
) -> Int64[np.ndarray, " n"]:
    """Join the pair of least cost of each cell, up to three times, while the cost is at most the bound.

    Returns the new heads. cells: of heads, each in one cell at most.
    """
    contrasts = np.float32(config.contrast_weight / 4.0) * np.einsum("mc->c", surface.contrasts.take(cells))
    for _ in range(_JOINS):
        costs = _pair_costs(surface, contrasts, cells, config.depth_weight)
        best = costs.argmin(axis=0)
        cheap = np.flatnonzero(costs.min(axis=0) <= config.largest_cost)
        cells, contrasts = cells[:, cheap], contrasts[cheap]
        _join_pairs(surface, heads, *np.take_along_axis(cells, _PAIRS[best[cheap]].T, axis=0))
    for _ in range(2):  # of a chain of up to four links, each round halves the length
        heads = heads[heads]
    return heads


def _pair_costs(
    surface: Surface, contrasts: Float32[np.ndarray, " cell"], cells: Int64[np.ndarray, "4 cell"], depth_weight: float
) -> Float32[np.ndarray, "6 cell"]:
    """Return the cost of joining each pair, infinite if one of the pair is absent.

    The cost is pi / 2 * w1 w2 / (w1 + w2) * (|colour difference|^2 + weighted contrast)
    * (1 + weighted difference of log distances), where w are the weights.
    """
    first, second = cells[_PAIRS[:, 0]], cells[_PAIRS[:, 1]]
    weights, others = surface.weights.take(first), surface.weights.take(second)
    product, total = weights * others, np.maximum(weights + others, _TINY)
    difference = surface.colours.take(first, axis=1) - surface.colours.take(second, axis=1)
    change = np.einsum("cpn,cpn->pn", difference, difference) * np.float32(1.0 / 3.0) + contrasts
    apart = 1.0 + np.float32(depth_weight) * np.abs(surface.logs.take(first) - surface.logs.take(second))
    costs: np.ndarray = np.where(product > 0.0, np.float32(0.5 * np.pi) * product / total * change * apart, np.inf)
    return costs


def _join_pairs(
    surface: Surface,
    heads: Int64[np.ndarray, " n"],
    first: Int64[np.ndarray, " pair"],
    second: Int64[np.ndarray, " pair"],
) -> None:
    """Replace the heavier of each pair by the mean of both, and set the weight of the other to 0."""
    is_lighter = surface.weights[first] < surface.weights[second]
    kept, dropped = np.where(is_lighter, second, first), np.where(is_lighter, first, second)
    heads[dropped] = kept
    weights = surface.weights[kept] + surface.weights[dropped]
    share = surface.weights[dropped] / weights
    for field in (surface.logs, surface.colours):
        field[..., kept] += share * (field[..., dropped] - field[..., kept])
    surface.weights[kept], surface.weights[dropped] = weights, 0.0
