"""The lens model of a photograph, and the pinhole to which it is undistorted."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fecocodec.container.camera_validation import MAX_FOCAL, MAX_PRINCIPAL_POINT, MIN_FOCAL
from fecocodec.errors import InputError

MAX_SIDE_PX = 10**6  # largest image side in a camera file
MAX_GROWTH = 2.0  # largest ratio of the sides of an undistorted image to those of the photograph
ASPECT_TOLERANCE = 0.01
_SOLVER_STEPS = 200


@dataclass(frozen=True)
class Lens:
    """Pinhole with Brown-Conrady distortion, in pixels of an image of width x height, pixel centres at i + 0.5.

    With (x, y) on the plane z = 1 and r2 = x^2 + y^2, the image point is at fx * xd + cx, fy * yd + cy, where
    xd = x * (1 + radial[0] r2 + radial[1] r2^2 + ...) + 2 p1 x y + p2 (r2 + 2 x^2)
    yd = y * (1 + radial[0] r2 + radial[1] r2^2 + ...) + p1 (r2 + 2 y^2) + 2 p2 x y
    with (p1, p2) = tangential: the OPENCV model of OpenCV, COLMAP and nerfstudio.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)

    @property
    def has_distortion(self) -> bool:
        return any(self.radial) or any(self.tangential)

    def scaled_to(self, width: int, height: int, place: str) -> "Lens":
        """Return the lens for the photograph resized to this size in pixels.

        Raises InputError, which begins with `place`, if the aspect ratios differ by more than 1%.
        """
        if abs(self.width * height - self.height * width) > ASPECT_TOLERANCE * self.width * height:
            turned = (self.width, self.height) == (height, width)
            remedy = (
                "store the pixels upright, without an EXIF orientation" if turned else "use the image it was made for"
            )
            raise InputError(
                f"{place}: the image is {width}x{height} pixels but its camera is for "
                f"{self.width}x{self.height}; {remedy}."
            )
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, cx=self.cx * sx, fy=self.fy * sy, cy=self.cy * sy
        )


def require_representable(lens: Lens, place: str) -> None:
    """Raise InputError, which begins with `place`, if focal length or principal point exceed the limits of streams."""
    for focal, centre, side in ((lens.fx, lens.cx, lens.width), (lens.fy, lens.cy, lens.height)):
        if not MIN_FOCAL <= focal / side <= MAX_FOCAL or not abs(centre / side) <= MAX_PRINCIPAL_POINT:
            raise InputError(
                f"{place}: the focal length is {focal / side:.3g} and the principal point {centre / side:.3g} image "
                f"sides, but {MIN_FOCAL:.3g} to {MAX_FOCAL:.0f} are possible; correct the camera."
            )


def undistorted(lens: Lens, place: str) -> Lens:
    """Return the pinhole whose image is the largest upright rectangle inside the undistorted photograph.

    The focal lengths, and thus the scale at the centre, do not change. Raises InputError, which begins with `place`, if
    the distortion is not invertible inside the image.
    """
    if not lens.has_distortion:
        return lens
    edge = np.linspace(0, 1, 65)
    zero, one = np.zeros_like(edge), np.ones_like(edge)
    left, right, top, bottom = (
        _undistort_points(lens, np.stack((u * lens.width, v * lens.height), axis=-1), place)
        for u, v in ((zero, edge), (one, edge), (edge, zero), (edge, one))
    )
    x0, x1 = _bounded(left[:, 0].max(), right[:, 0].min(), lens.width, place)
    y0, y1 = _bounded(top[:, 1].max(), bottom[:, 1].min(), lens.height, place)
    return Lens(x1 - x0, y1 - y0, lens.fx, lens.fy, lens.cx - x0, lens.cy - y0)


def distort(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Apply the distortion to points on the plane z = 1."""
    return plane * _radial_factor(lens, plane)[..., None] + _tangential_shift(lens, plane)


def _undistort_points(lens: Lens, points: Float[np.ndarray, "n 2"], place: str) -> Float[np.ndarray, "n 2"]:
    """Invert the distortion of image points, in pixels, by fixed-point iteration."""
    seen = (points - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    plane = seen.copy()
    with np.errstate(all="ignore"):  # the check below detects divergence
        for _ in range(_SOLVER_STEPS):
            plane = (seen - _tangential_shift(lens, plane)) / _radial_factor(lens, plane)[:, None]
        error_px = np.abs((distort(lens, plane) - seen) * (lens.fx, lens.fy))
    if not (error_px < 0.05).all():
        raise InputError(
            f"{place}: its lens distortion has no inverse inside the image; check k1, k2, p1, p2 or undistort it."
        )
    return plane * (lens.fx, lens.fy) + (lens.cx, lens.cy)


def _radial_factor(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    r2 = (plane**2).sum(axis=-1)
    return 1 + sum(k * r2 ** (power + 1) for power, k in enumerate(lens.radial))


def _tangential_shift(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    p1, p2 = lens.tangential
    x, y = plane[..., 0], plane[..., 1]
    r2 = x**2 + y**2
    return np.stack((2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y), axis=-1)


def _bounded(low: float, high: float, length: int, place: str) -> tuple[int, int]:
    """Return the first and last whole pixel inside [low, high], limited by MAX_GROWTH."""
    margin = (MAX_GROWTH - 1) / 2 * length
    first, last = int(np.ceil(max(low, -margin) - 1e-6)), int(np.floor(min(high, length + margin) + 1e-6))
    if last <= first:
        raise InputError(f"{place}: its lens distortion leaves no usable image; check k1, k2, p1, p2 or undistort it.")
    return first, last
