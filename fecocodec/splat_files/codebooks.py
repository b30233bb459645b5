"""Vector quantisation for output formats: codebooks of 256 values and palettes of vectors. Deterministic."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from fecocodec.splat_files.kd_order import kd_order

CODEBOOK_SIZE = 256
_SCALAR_STEPS, _VECTOR_STEPS = 20, 2  # of Lloyd's algorithm


def scalar_codebook(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "256"]:
    """Return CODEBOOK_SIZE ascending values that represent `values` with little squared error (Lloyd-Max)."""
    ordered = np.sort(values)
    sums = np.concatenate(([0.0], np.cumsum(ordered)))
    quantiles = np.quantile(ordered, (np.arange(CODEBOOK_SIZE) + 0.5) / CODEBOOK_SIZE)
    uniform = np.linspace(ordered[0], ordered[-1], CODEBOOK_SIZE)
    codebook = np.sort((quantiles + uniform) / 2)  # quantiles alone leave the tails of long distributions empty
    for _ in range(_SCALAR_STEPS):
        edges = np.searchsorted(ordered, (codebook[1:] + codebook[:-1]) / 2)
        edges = np.concatenate(([0], edges, [len(ordered)]))
        counts = np.diff(edges)
        codebook = np.where(counts > 0, np.diff(sums[edges]) / np.maximum(counts, 1), codebook)
        codebook = np.maximum.accumulate(codebook)
    return codebook


def nearest_in_codebook(
    codebook: Float[np.ndarray, "256"], values: Float[np.ndarray, "*shape"]
) -> Int[np.ndarray, "*shape"]:
    """Return the index of the nearest entry of an ascending codebook."""
    return np.searchsorted((codebook[1:] + codebook[:-1]) / 2, values)


def palette(
    vectors: Float[np.ndarray, "n axis"], size: int
) -> tuple[Float[np.ndarray, "entry axis"], Int[np.ndarray, " n"]]:
    """Return at most `size` vectors that represent `vectors`, and the index of the nearest one for each.

    Starts with the means of the leaves of a k-d tree and refines them by Lloyd's algorithm.
    """
    run = -(-len(vectors) // size)
    order = kd_order(vectors, run)
    labels = np.empty(len(vectors), np.int64)
    labels[order] = np.arange(len(vectors)) // run
    for _ in range(_VECTOR_STEPS):
        entries = _means(vectors, labels)
        labels = KDTree(entries).query(vectors)[1]
    return entries, labels


def _means(vectors: Float[np.ndarray, "n axis"], labels: Int[np.ndarray, " n"]) -> Float[np.ndarray, "entry axis"]:
    """Return the mean of the vectors of each label that occurs."""
    _, labels, counts = np.unique(labels, return_inverse=True, return_counts=True)
    sums = [np.bincount(labels, weights=column) for column in vectors.T]
    return np.stack(sums, axis=1) / counts[:, None]
