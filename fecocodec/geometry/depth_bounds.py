"""Near and far of a set of depths."""

import numpy as np
from jaxtyping import Float

MIN_SAMPLES = 50  # percentiles of fewer depths are not reliable
_PERCENTILES = (0.01, 0.5, 0.99)
_MOST_MEDIANS = 1e9
_MARGIN = 1.15  # the percentiles are widened by this factor on both sides
_MAX_FAR_OVER_MEDIAN = 40 / 3  # limits the effect of sky and outliers on `far`


def bounds_of_depths(depths: Float[np.ndarray, " n"]) -> tuple[float, float] | None:
    """Return (near, far) of depths: the 1st and 99th percentile, each widened by 15%; far is at most 13.3 medians.

    Depths that are not finite, or beyond a billion medians, are errors and do not count.
    Returns None for fewer than MIN_SAMPLES depths.
    """
    ordered = np.sort(depths[np.isfinite(depths)].astype(np.float64))
    if len(ordered):
        ordered = ordered[: np.searchsorted(ordered, _MOST_MEDIANS * np.median(ordered), "right")]
    if len(ordered) < MIN_SAMPLES:
        return None
    near, median, far = (float(ordered[round(share * (len(ordered) - 1))]) for share in _PERCENTILES)
    return near / _MARGIN, min(far * _MARGIN, median * _MAX_FAR_OVER_MEDIAN)
