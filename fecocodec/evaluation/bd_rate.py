"""Bjontegaard metrics: BD-rate and BD-PSNR of two rate-distortion curves.

Bjontegaard, "Calculation of average PSNR differences between RD-curves", VCEG-M33, 2001, with piecewise cubic
interpolation instead of a polynomial, as in the common test conditions of the video standards (PCHIP: Fritsch and
Carlson, "Monotone Piecewise Cubic Interpolation", 1980).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

Point = tuple[float, float]  # (rate, quality); a larger quality is better, in dB for `bd_psnr`

_NUM_SAMPLES = 1001


def bd_rate(anchor: Sequence[Point], test: Sequence[Point], *, least_overlap: float = 0.0) -> float | None:
    """Return the mean rate difference at equal quality, in percent: -50 means that `test` needs half the rate.

    Returns None if the quality ranges do not overlap by more than 0 and at least `least_overlap`, or if a curve has
    fewer than two Pareto-optimal points.
    """
    ours, theirs = pareto_front(test), pareto_front(anchor)
    difference = _mean_difference(_swapped(theirs), _swapped(ours), least_overlap)
    return None if difference is None else 100.0 * (float(np.exp(difference)) - 1.0)


def bd_psnr(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Return the mean quality difference at equal rate, in dB; positive if `test` is better.

    Returns None if the rate ranges do not overlap, or if a curve has fewer than two Pareto-optimal points.
    """
    return _mean_difference(pareto_front(anchor), pareto_front(test))


def pareto_front(points: Sequence[Point]) -> Float[np.ndarray, "point 2"]:
    """Return (log rate, quality) of the Pareto-optimal points, ordered by rate; both columns increase strictly."""
    front: list[Point] = []
    for rate, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or quality > front[-1][1]:
            front.append((float(np.log(rate)), quality))
    return np.array(front).reshape(-1, 2)


def _swapped(curve: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
    return curve[:, ::-1]


def _mean_difference(
    anchor: Float[np.ndarray, "_ 2"], test: Float[np.ndarray, "_ 2"], least_overlap: float = 0.0
) -> float | None:
    """Return the mean of test(x) - anchor(x) over the common range of x, or None if there is none."""
    if min(len(anchor), len(test)) < 2:
        return None
    low, high = max(anchor[0, 0], test[0, 0]), min(anchor[-1, 0], test[-1, 0])
    if not low < high or high - low < least_overlap:
        return None
    x = np.linspace(low, high, _NUM_SAMPLES)
    difference = PchipInterpolator(*test.T)(x) - PchipInterpolator(*anchor.T)(x)
    return float(np.trapezoid(difference, x) / (high - low))
