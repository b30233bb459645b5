"""Choose photographs by their overlap with each other: a few that cover all, and those near them."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from fecocodec.captures.view_spread import LEAST_BASELINE

DUPLICATE_OVERLAP = 0.9  # of photographs from one position
LEAST_OVERLAP = 0.3  # estimated covisibility; photographs with less are no neighbours

Overlap = Float[np.ndarray, "view view"]  # estimated covisibility, in [0, 1]


def k_centres(overlap: Overlap, chosen: list[int], candidates: list[int], count: int) -> list[int]:
    """Return up to `count` candidates, each the one that overlaps least with those chosen before (greedy k-centre).

    chosen: views from which the choice starts; without any, it starts with the candidate of largest total overlap.
    """
    chosen, rest, found = list(chosen), list(candidates), list[int]()
    while rest and len(found) < count:
        if chosen:
            best = int(overlap[np.ix_(rest, chosen)].max(axis=1).argmin())
        else:
            best = int(overlap[np.ix_(rest, rest)].sum(axis=1).argmax())
        found.append(rest.pop(best))
        chosen.append(found[-1])
    return found


def within_reach(overlap: Overlap, indices: Iterable[int], of: list[int]) -> list[int]:
    """Return which photographs overlap enough with one of others."""
    return [index for index in indices if overlap[index, of].max(initial=0.0) >= LEAST_OVERLAP]


def with_neighbours(overlap: Overlap, indices: list[int]) -> list[int]:
    """Return which photographs overlap enough with another of them."""
    of_others = overlap - np.diag(np.diagonal(overlap))
    return within_reach(of_others, indices, indices)


def spread_over(overlap: Overlap, candidates: list[int], count: int) -> list[int]:
    """Return photographs spread over the poses: the most central one of each of `count` neighbourhoods."""
    centres = k_centres(overlap, [], candidates, count)
    if not centres:
        return []
    nearest = overlap[np.ix_(candidates, centres)].argmax(axis=1)
    groups = [[index for index, own in zip(candidates, nearest, strict=True) if own == group] for group in set(nearest)]
    return sorted(group[int(overlap[np.ix_(group, group)].sum(axis=1).argmax())] for group in groups)


def is_duplicate(overlap: Float[np.ndarray, " view"], baseline: Float[np.ndarray, " view"]) -> bool:
    """Return whether a photograph shows what a coded one shows, from the same position."""
    return bool(((baseline < LEAST_BASELINE) & (overlap >= DUPLICATE_OVERLAP)).any())
