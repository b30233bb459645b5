"""What the neighbours of a Gaussian on its view's grid say about it: local contrast, and what hides it. NumPy only."""

import numpy as np
from jaxtyping import Float32

_REACH = 2  # radius of the window of the local contrast, in Gaussians
_VARIANCE = 1.2  # of the footprint that hides neighbours, in squared Gaussians
_LARGEST_DEPTH = np.float32(1.5)  # bound on the optical depth of one Gaussian per cell of the grid
_STEEPNESS = np.float32(1.5)  # chosen on validation scenes; the Gaussians of the other views hide too


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
