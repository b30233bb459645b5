"""Bjontegaard's comparison of two rate-distortion curves.

Bjontegaard, "Calculation of average PSNR differences between RD-curves", VCEG-M33, 2001, with the piecewise cubic
interpolation that replaced his polynomial in the standards' common test conditions (PCHIP: Fritsch and Carlson,
"Monotone Piecewise Cubic Interpolation", 1980).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Point = tuple[float, float]  # (rate, quality in dB)

_NUM_SAMPLES = 1001


def bd_rate(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Mean difference in rate at equal quality, in percent: -50 means that `test` needs half the rate of `anchor`.

    None where the curves have no quality in common, or fewer than two points that are not dominated.
    """
    ours, theirs = _front(test), _front(anchor)
    difference = _mean_difference(_swapped(theirs), _swapped(ours))
    return None if difference is None else 100.0 * (float(np.exp(difference)) - 1.0)


def bd_psnr(anchor: Sequence[Point], test: Sequence[Point]) -> float | None:
    """Mean difference in quality at equal rate, in dB, positive where `test` is better; None as for `bd_rate`."""
    return _mean_difference(_front(anchor), _front(test))


def _front(points: Sequence[Point]) -> Float[np.ndarray, "point 2"]:
    """(log rate, quality) of the points that no other beats in both, by rising rate: both columns rise strictly."""
    front: list[Point] = []
    for rate, quality in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or quality > front[-1][1]:
            front.append((float(np.log(rate)), quality))
    return np.array(front).reshape(-1, 2)


def _swapped(curve: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
    return curve[:, ::-1]


def _mean_difference(anchor: Float[np.ndarray, "_ 2"], test: Float[np.ndarray, "_ 2"]) -> float | None:
    """Mean of test(x) - anchor(x) over the x that both curves reach."""
    if min(len(anchor), len(test)) < 2:
        return None
    low, high = max(anchor[0, 0], test[0, 0]), min(anchor[-1, 0], test[-1, 0])
    if not low < high:
        return None
    x = np.linspace(low, high, _NUM_SAMPLES)
    return float(np.trapezoid(interpolate(test, x) - interpolate(anchor, x), x) / (high - low))


def interpolate(curve: Float[np.ndarray, "point 2"], x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Monotone piecewise cubic through at least two points, whose first column rises; x lies inside it."""
    knots, values = curve.T
    slopes = _slopes(knots, values)
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    width = np.diff(knots)[left]
    t = (x - knots[left]) / width
    start = (1 + 2 * t) * (1 - t) ** 2 * values[left] + t * (1 - t) ** 2 * width * slopes[left]
    end = t**2 * (3 - 2 * t) * values[left + 1] + t**2 * (t - 1) * width * slopes[left + 1]
    interpolated: np.ndarray = start + end
    return interpolated


def _slopes(knots: Float[np.ndarray, " point"], values: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
    """Derivative at each knot: weighted harmonic means of the secants inside, one-sided formula at the ends."""
    steps, secants = np.diff(knots), np.diff(values) / np.diff(knots)
    if len(knots) == 2:
        return np.repeat(secants, 2)
    slopes = np.zeros(len(knots))
    before, after = 2 * steps[1:] + steps[:-1], steps[1:] + 2 * steps[:-1]
    is_monotone = secants[:-1] * secants[1:] > 0
    with np.errstate(divide="ignore"):
        inner = (before + after) / (before / secants[:-1] + after / secants[1:])
    slopes[1:-1] = np.where(is_monotone, inner, 0.0)
    slopes[0] = _end_slope(steps[0], steps[1], secants[0], secants[1])
    slopes[-1] = _end_slope(steps[-1], steps[-2], secants[-1], secants[-2])
    return slopes


def _end_slope(step: float, next_step: float, secant: float, next_secant: float) -> float:
    slope = ((2 * step + next_step) * secant - step * next_secant) / (step + next_step)
    if slope * secant <= 0:
        return 0.0
    if secant * next_secant <= 0 and abs(slope) > 3 * abs(secant):
        return 3 * secant
    return slope
