"""The next lambda of a search, from encodings at other lambdas: the secant method with bounded slopes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fecocodec.container.lagrangian import LAMBDA_Q_MAX

# Typical change of the margin per step of lambda_q, on training scenes: ln(bytes) and dB.
SIZE_SLOPE, PSNR_SLOPE = 0.0015, -0.003
SIZE_TOLERANCE, PSNR_TOLERANCE = 0.02, 0.05  # margins from 0 to this are close enough; half of it is aimed at
LARGEST_SLOPE_RATIO = 5.0  # between a secant and the typical slope; steeper and flatter ones are noise


@dataclass(frozen=True)
class Point:
    """One encoding. margin: how far inside the target, negative outside: ln(target / bytes), or PSNR - target in dB.

    slope: typical change of the margin per step of lambda_q. tolerance: the largest margin that is close enough.
    """

    lambda_q: int
    margin: float
    slope: float
    tolerance: float

    @classmethod
    def of_size(cls, lambda_q: int, num_bytes: int, target_bytes: float) -> "Point":
        """A file of `num_bytes` where at most `target_bytes` are wanted."""
        return cls(lambda_q, math.log(target_bytes / num_bytes), SIZE_SLOPE, SIZE_TOLERANCE)

    @classmethod
    def of_psnr(cls, lambda_q: int, psnr: float, target_psnr: float) -> "Point":
        """A file of this PSNR in dB where at least `target_psnr` is wanted."""
        return cls(lambda_q, psnr - target_psnr, PSNR_SLOPE, PSNR_TOLERANCE)


def is_inside(point: Point) -> bool:
    """Whether the target is reached closely."""
    return 0.0 <= point.margin <= point.tolerance


def next_lambda_q(fast: Sequence[Point], full: Sequence[Point] = ()) -> int:
    """The lambda_q at which the margin should be half of the tolerance, in [0, LAMBDA_Q_MAX].

    From the fast encodings' curve, or, where there are full encodings, from theirs. Every attempt after the third that
    leaves the target unreached goes twice as far inside. Never one that a full encoding has tried.
    """
    points = full or fast
    tries_outside = max(0, len(full) - 2) if all(point.margin < 0.0 for point in full) else 0
    aim = 0.5 * points[0].tolerance * 2.0**tries_outside
    nearest = _nearest(points, aim)[0]
    step = round((aim - nearest.margin) / _slope(_nearest(points if len(points) > 1 else fast, aim)))
    wanted = min(max(nearest.lambda_q + step, 0), LAMBDA_Q_MAX)
    tried = {point.lambda_q for point in full}
    inwards = 1 if nearest.slope > 0 else -1
    while wanted in tried and 0 <= wanted + inwards <= LAMBDA_Q_MAX:
        wanted += inwards
    return wanted


def _nearest(points: Sequence[Point], aim: float) -> list[Point]:
    return sorted(points, key=lambda point: abs(point.margin - aim))


def _slope(points: Sequence[Point]) -> float:
    """Slope of the secant through the first two points, within a factor of the typical slope."""
    typical = points[0].slope
    if len(points) == 1 or points[0].lambda_q == points[1].lambda_q:
        return typical
    secant = (points[1].margin - points[0].margin) / (points[1].lambda_q - points[0].lambda_q)
    return typical * min(max(secant / typical, 1.0 / LARGEST_SLOPE_RATIO), LARGEST_SLOPE_RATIO)
