"""Choice of context and target frames of a captured scene, by overlap and baseline."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

LEAST_OVERLAP, MOST_OVERLAP = 0.3, 0.9
LEAST_BASELINE = 0.02  # in depths; below it, disparity is a few pixels and does not determine depth

Pairs = list[tuple[int, int]]


def relative_baselines(
    extrinsics: Float[ndarray, "frame 4 4"], near: float, far: float
) -> Float[ndarray, "frame frame"]:
    """Return the distances between camera centres, divided by the depth in the middle of the inverse-depth range."""
    centres = extrinsics[:, :3, 3]
    typical_depth = 2.0 / (1.0 / near + 1.0 / far)
    distances: ndarray = np.linalg.norm(centres[:, None] - centres[None], axis=-1) / typical_depth
    return distances


def context_pairs(overlap: Float[ndarray, "frame frame"], baselines: Float[ndarray, "frame frame"]) -> Pairs:
    """Return the pairs whose overlap and baseline are in range; if there are none, the pair of largest overlap."""
    is_good = (overlap > LEAST_OVERLAP) & (overlap < MOST_OVERLAP) & (baselines > LEAST_BASELINE)
    first, second = np.nonzero(np.triu(is_good, 1))
    if len(first):
        return list(zip(first.tolist(), second.tolist(), strict=True))
    best = np.unravel_index(np.argmax(np.triu(overlap, 1)), overlap.shape)
    return [(int(best[0]), int(best[1]))]


def choose_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], pairs: Pairs, num_context: int, num_target: int
) -> list[int]:
    """Return context frames in random order, connected by overlap, then target frames that overlap two of them.

    overlap: share of one frame's content that another frame sees, symmetric. pairs: from `context_pairs`. Context
    frames are distinct; target frames repeat if there are too few.
    """
    context = _connected_frames(rng, overlap, pairs, num_context)
    return [*context, *_target_frames(rng, overlap, context, num_target)]


def _connected_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], pairs: Pairs, count: int
) -> list[int]:
    """Draw a pair, then add frames that overlap a chosen one; if none does, the frame of largest overlap."""
    frames = [int(frame) for frame in rng.permutation(pairs[int(rng.integers(len(pairs)))])][:count]
    while len(frames) < count:
        largest = overlap[frames].max(0)
        largest[frames] = -1.0
        candidates = np.flatnonzero((largest > LEAST_OVERLAP) & (largest < MOST_OVERLAP))
        frames.append(int(rng.choice(candidates)) if len(candidates) else int(largest.argmax()))
    return frames


def _target_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], context: list[int], count: int
) -> list[int]:
    """Draw other frames with a probability that grows with their overlap with two context views."""
    support = np.sort(overlap[context], axis=0)[-2:].min(0)
    support[context] = -1.0
    candidates = np.flatnonzero(support > LEAST_OVERLAP)
    if len(candidates) < count:
        candidates = np.argsort(-support, kind="stable")[: min(count, max(len(support) - len(context), 1))]
    if len(candidates) < count:
        return [int(frame) for frame in rng.choice(candidates, count)]
    # Weighted sampling without replacement: sort by a random key to the power of 1 / weight
    # (Efraimidis and Spirakis, "Weighted random sampling with a reservoir", 2006).
    keys = rng.random(len(candidates)) ** (1 / np.maximum(support[candidates], 0.01))
    return [int(frame) for frame in candidates[np.argsort(-keys)[:count]]]
