"""Search for lambda by the secant method with bounded slopes: the next lambda, given the encodings so far."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fecocodec.container.lambda_quantisation import LAMBDA_MIN, LAMBDA_Q_MAX
from fecocodec.errors import InputError


@dataclass(frozen=True)
class AtMostKib:
    """Target: the best quality in a file of at most `kib` KiB."""

    kib: float

    def __post_init__(self) -> None:
        """Raise InputError for a size that no file can have."""
        _require_positive(self.kib, "KiB")

    def __str__(self) -> str:
        return f"{self.kib:g} KiB"


@dataclass(frozen=True)
class AtLeastPsnr:
    """Target: the smallest file whose decoded context views have at least this PSNR in dB."""

    psnr: float

    def __post_init__(self) -> None:
        """Raise InputError for a quality that no file can have."""
        _require_positive(self.psnr, "dB")

    def __str__(self) -> str:
        return f"{self.psnr:g} dB"


@dataclass(frozen=True)
class AtLeastNewPsnr(AtLeastPsnr):
    """Target: the smallest file with at least this PSNR in dB at new views, mean over photographs that are not coded.

    They choose lambda, and nothing else; what is measured on them is then fitted.
    """

    def __str__(self) -> str:
        return f"{self.psnr:g} dB at new views"


Target = AtMostKib | AtLeastPsnr


def target_note(lmbda: float, target: Target) -> str:
    """Return the sentence on the lambda that was chosen for a target."""
    if isinstance(target, AtMostKib) and lmbda <= LAMBDA_MIN:
        return f"the smallest lambda, {lmbda:.3g}, already meets the target of {target}; no lambda makes a larger file."
    return f"lambda {lmbda:.3g} reaches the target of {target}."


def _require_positive(value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"a target of {value} {unit} cannot be reached; give a positive number.")


# Typical change of the margin per unit of lambda_q, on training scenes: ln(bytes) and dB.
SIZE_SLOPE, PSNR_SLOPE = 0.0015, -0.003
SIZE_TOLERANCE, PSNR_TOLERANCE = 0.02, 0.05  # margins in [0, tolerance] end the search, which aims at the middle
LARGEST_SLOPE_RATIO = 5.0  # bound of secant slope / typical slope, and of its inverse; limits the effect of noise


@dataclass(frozen=True)
class Point:
    """One encoding, compared with the target.

    margin: ln(target / bytes), or PSNR - target in dB; negative if the target is missed. slope: typical change of the
    margin per unit of lambda_q. tolerance: largest margin at which the search ends.
    """

    lambda_q: int
    margin: float
    slope: float
    tolerance: float

    @property
    def is_inside(self) -> bool:
        """Whether the target is reached within the tolerance."""
        return 0.0 <= self.margin <= self.tolerance


def point_of(lambda_q: int, num_bytes: int, psnr: float, target: Target) -> Point:
    """Return the point of a file of so many bytes, with this PSNR in dB."""
    if isinstance(target, AtMostKib):
        return Point(lambda_q, math.log(1024 * target.kib / num_bytes), SIZE_SLOPE, SIZE_TOLERANCE)
    return Point(lambda_q, psnr - target.psnr, PSNR_SLOPE, PSNR_TOLERANCE)


def next_lambda_q(fast: Sequence[Point], full: Sequence[Point] = ()) -> int:
    """Return the lambda_q, in [0, LAMBDA_Q_MAX], at which the margin is expected to be half of the tolerance.

    fast: encodings without optimisation, used until there is a full encoding. full: encodings with optimisation. While
    no full encoding reaches the target, the margin aimed at doubles with each one from the third on. The result is
    never the lambda_q of a full encoding, unless the end of the range is reached.
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
    """Return the slope of the secant through the first two points, bounded by LARGEST_SLOPE_RATIO."""
    typical = points[0].slope
    if len(points) == 1 or points[0].lambda_q == points[1].lambda_q:
        return typical
    secant = (points[1].margin - points[0].margin) / (points[1].lambda_q - points[0].lambda_q)
    return typical * min(max(secant / typical, 1.0 / LARGEST_SLOPE_RATIO), LARGEST_SLOPE_RATIO)
