"""Which pairs of many photographs are worth matching: those whose largest features look alike.

Source: Wu, "Towards Linear-Time Incremental Structure from Motion", 2013 (preemptive matching).
"""

import numpy as np
from jaxtyping import Float, Int, UInt8

_ALL_PAIRS_UP_TO = 24  # photographs
_COMPARED = 300  # features of a photograph, those of the largest scale
_PARTNERS = 10  # of a photograph, those with the most features in common
_NEIGHBOURS = 2  # on both sides in the order of the names, which are always partners
_MOST_RATIO = 0.8  # of the angles between a descriptor and its nearest and second nearest, as in full matching

Descriptors = Float[np.ndarray, "compared value"]
Features = tuple[Float[np.ndarray, " feature"], UInt8[np.ndarray, "feature value"]]
Pair = tuple[str, str]


def likely_pairs(features: dict[str, Features]) -> list[Pair]:
    """Return the pairs to match, names in order; all of up to 24 photographs. features: scales and descriptors."""
    names, count = sorted(features), len(features)
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    is_chosen = apart <= (_NEIGHBOURS if count > _ALL_PAIRS_UP_TO else count)
    if count > _ALL_PAIRS_UP_TO:
        common = _common_features([_largest(*features[name]) for name in names])
        best = np.argsort(-common, axis=1, kind="stable")[:, :_PARTNERS]
        np.put_along_axis(is_chosen, best, True, axis=1)
    return [(names[first], names[second]) for first, second in np.argwhere(np.triu(is_chosen | is_chosen.T, 1))]


def pairs_to_match_again(counts: dict[Pair, int], missing: set[str]) -> list[Pair]:
    """Return the pairs of photographs that have no camera with the _PARTNERS with which they have the most matches.

    counts: number of matches of each pair that has any. missing: names of photographs without a camera.
    """
    chosen = set[Pair]()
    for name in sorted(missing):
        pairs = sorted((pair for pair in counts if name in pair), key=lambda pair: (-counts[pair], pair))
        chosen.update(pairs[:_PARTNERS])
    return sorted(chosen)


def _largest(scales: Float[np.ndarray, " feature"], descriptors: UInt8[np.ndarray, "feature value"]) -> Descriptors:
    """Return _COMPARED unit descriptors, filled up with zeros."""
    chosen = descriptors[np.argsort(-scales, kind="stable")[:_COMPARED]].astype(np.float32).reshape(-1, 128)
    units = np.zeros((_COMPARED, 128), np.float32)
    units[: len(chosen)] = chosen / np.maximum(1e-6, np.linalg.norm(chosen, axis=1, keepdims=True))
    return units


def _common_features(descriptors: list[Descriptors]) -> Int[np.ndarray, "photograph photograph"]:
    """Return how many features of each pair are mutual nearest neighbours, and clearly nearer than the next."""
    common = np.zeros((len(descriptors), len(descriptors)), np.int64)
    for index, first in enumerate(descriptors):
        for other, second in enumerate(descriptors[:index]):
            common[index, other] = common[other, index] = _num_matches(first @ second.T)
    return common


def _num_matches(cosines: Float[np.ndarray, "compared compared"]) -> int:
    rows = np.arange(len(cosines))
    nearest = cosines.argmax(axis=1)
    is_mutual = cosines.argmax(axis=0)[nearest] == rows
    first = cosines[rows, nearest]
    cosines[rows, nearest] = -1.0
    second = cosines.max(axis=1)
    is_clear = np.arccos(np.clip(first, -1, 1)) < _MOST_RATIO * np.arccos(np.clip(second, -1, 1))
    return int((is_mutual & is_clear).sum())
