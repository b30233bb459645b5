"""The lens model of a photograph, and the pinhole to which it is undistorted."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fecocodec.container.camera_validation import MAX_FOCAL, MAX_PRINCIPAL_POINT, MIN_FOCAL
from fecocodec.errors import InputError

FISHEYE_MODELS = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE")
CAMERA_MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"),
    *FISHEYE_MODELS,
)  # those of COLMAP that are undistorted here
# Undistorted by COLMAP, and by other programs.
_OTHER_COLMAP_MODELS = (
    *("FOV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "EUCM"),
)
_OTHER_MODELS = ("FISHEYE624", "FTHETA")
_PANORAMAS = (
    *("EQUIRECTANGULAR", "CYLINDRICAL", "SPHERICAL"),
    *("OMNIDIRECTIONALSTEREO_L", "OMNIDIRECTIONALSTEREO_R", "VR180_L", "VR180_R"),
)
MAX_SIDE_PX = 10**6  # largest image side in a camera file
MAX_GROWTH = 2.0  # largest ratio of the sides of an undistorted image to those of the photograph
# A pinhole of more than 120 degrees shows little but stretched edges. Nor is the image of one, cut from a photograph,
# farther than this from the optical axis.
MAX_SLOPE = np.tan(np.radians(60.0))
_NEAR_CENTRE, _LEAST_ASPECT = 0.05, 1.3  # of swapped coordinates, in sides
ASPECT_TOLERANCE = 0.01
_SOLVER_STEPS = 200
_ANGLES = np.radians(np.linspace(0, 89, 8193))  # of rays to the optical axis; linear interpolation errs by 1e-8


@dataclass(frozen=True)
class Lens:
    """Pinhole or fisheye with distortion, in pixels of an image of width x height, pixel centres at i + 0.5.

    With (x, y) on the plane z = 1 and r2 = x^2 + y^2, the image point is at fx * xd + cx, fy * yd + cy, where
    xd = x * factor + 2 p1 x y + p2 (r2 + 2 x^2)
    yd = y * factor + p1 (r2 + 2 y^2) + 2 p2 x y
    factor = (1 + radial[0] r2 + radial[1] r2^2 + ...) / (1 + denominator[0] r2 + denominator[1] r2^2 + ...)
    with (p1, p2) = tangential: OPENCV and FULL_OPENCV of OpenCV, COLMAP and nerfstudio. For a fisheye, xd = x * factor
    and yd = y * factor with the angle a = atan(r) and
    factor = a (1 + radial[0] a^2 + radial[1] a^4 + ...) / r: OPENCV_FISHEYE of the same programs.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    denominator: tuple[float, ...] = ()
    is_fisheye: bool = False

    @property
    def has_distortion(self) -> bool:
        return self.is_fisheye or any(self.radial) or any(self.tangential) or any(self.denominator)

    def scaled_to(self, width: int, height: int, place: str) -> "Lens":
        """Return the lens for the photograph resized to this size in pixels.

        Raises InputError, which begins with `place`, if the aspect ratios differ by more than 1%.
        """
        if abs(self.width * height - self.height * width) > ASPECT_TOLERANCE * self.width * height:
            turned = (self.width, self.height) == (height, width)
            remedy = (
                "turn the pixels by 90 degrees (an EXIF orientation is not applied), or swap the camera's sides"
                if turned
                else "use the image it was made for"
            )
            raise InputError(
                f"{place}: the image is {width}x{height} pixels but its camera is for "
                f"{self.width}x{self.height}; {remedy}."
            )
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, cx=self.cx * sx, fy=self.fy * sy, cy=self.cy * sy
        )


def require_known_model(model: str, place: str) -> None:
    """Raise InputError, which begins with `place`, for a camera model that is not one of CAMERA_MODELS."""
    if model in CAMERA_MODELS:
        return
    if model in _PANORAMAS:
        raise InputError(
            f"{place}: panoramas ({model}) are not read; cut them into perspective images, as `ns-process-data` of "
            "nerfstudio does for its camera type equirectangular."
        )
    if model in (*_OTHER_COLMAP_MODELS, *_OTHER_MODELS):
        how = "with `colmap image_undistorter` first" if model in _OTHER_COLMAP_MODELS else "the images first"
        raise InputError(f"{place}: camera model {model} is not supported; undistort {how}.")
    raise InputError(f"{place}: camera model {model} is not known; use one of {', '.join(CAMERA_MODELS)}.")


def lens_of_model(model: str, size: tuple[int, int], values: Mapping[str, float]) -> Lens:
    """Return the lens of one of CAMERA_MODELS. size: (width, height) in pixels.

    values: fx, fy, cx and cy in pixels, and the coefficients k1 to k6, p1 and p2, which are 0 by default. COLMAP and
    nerfstudio name models and coefficients alike; OPENCV may have nerfstudio's k3 and k4.
    """
    k1, k2, k3, k4, k5, k6 = (values.get(f"k{index}", 0.0) for index in range(1, 7))
    lens = Lens(*size, values["fx"], values["fy"], values["cx"], values["cy"])
    if model in FISHEYE_MODELS:
        return replace(lens, radial=(k1, k2, k3, k4), is_fisheye=True)
    tangential = values.get("p1", 0.0), values.get("p2", 0.0)
    if model == "FULL_OPENCV":
        return replace(lens, radial=(k1, k2, k3), denominator=(k4, k5, k6), tangential=tangential)
    return replace(lens, radial=(k1, k2, k3, k4), tangential=tangential)


def require_representable(lens: Lens, place: str) -> None:
    """Raise InputError, which begins with `place`, if focal length or principal point exceed the limits of streams.

    Also if the principal point is so far outside that no pinhole shows this image, in parts of the image, or the centre
    of a turned one. Without pixels, the lens may be of a 1x1 image.
    """
    for focal, centre, side in ((lens.fx, lens.cx, lens.width), (lens.fy, lens.cy, lens.height)):
        if not MIN_FOCAL <= focal / side <= MAX_FOCAL or not abs(centre / side) <= MAX_PRINCIPAL_POINT:
            raise InputError(
                f"{place}: the focal length is {focal / side:.3g} and the principal point {centre / side:.3g} image "
                f"sides, but {MIN_FOCAL:.3g} to {MAX_FOCAL:.0f} are possible; correct the camera."
            )
    slope = max(abs(lens.cx - lens.width / 2) / lens.fx, abs(lens.cy - lens.height / 2) / lens.fy)
    is_in_parts = 0 < lens.cx <= 1 and 0 < lens.cy <= 1 < min(lens.width, lens.height)
    if slope > MAX_SLOPE or is_in_parts or _is_centre_of_turned(lens):
        raise InputError(
            f"{place}: the principal point ({lens.cx:.6g}, {lens.cy:.6g}) cannot be that of an image of "
            f"{lens.width}x{lens.height} with a focal length of {lens.fx:.6g}; give all in one unit, and cx before cy."
        )


def _is_centre_of_turned(lens: Lens) -> bool:
    """Return whether cx and cy, or width and height, seem to be swapped."""
    across, down = abs(lens.cx - lens.height / 2) / lens.height, abs(lens.cy - lens.width / 2) / lens.width
    short, long = sorted((lens.width, lens.height))
    return max(across, down) < _NEAR_CENTRE and long > _LEAST_ASPECT * short


def undistorted(lens: Lens, place: str) -> Lens:
    """Return the pinhole whose image is the largest upright rectangle inside the undistorted photograph.

    The focal lengths, and thus the scale at the centre, do not change. Of a fisheye at most 120 degrees are kept.
    Raises InputError, which begins with `place`, if the distortion is not invertible inside the image.
    """
    if not lens.has_distortion:
        return lens
    edge = np.linspace(0, 1, 65)
    zero, one = np.zeros_like(edge), np.ones_like(edge)
    left, right, top, bottom = (
        _undistort_points(lens, np.stack((u * lens.width, v * lens.height), axis=-1), place)
        for u, v in ((zero, edge), (one, edge), (edge, zero), (edge, one))
    )
    x0, x1 = _bounded(left[:, 0].max(), right[:, 0].min(), lens.width, _reach(lens, lens.fx, lens.cx), place)
    y0, y1 = _bounded(top[:, 1].max(), bottom[:, 1].min(), lens.height, _reach(lens, lens.fy, lens.cy), place)
    return Lens(x1 - x0, y1 - y0, lens.fx, lens.fy, lens.cx - x0, lens.cy - y0)


def distort(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Apply the distortion to points on the plane z = 1."""
    return plane * _radial_factor(lens, plane)[..., None] + _tangential_shift(lens, plane)


def _undistort_points(lens: Lens, points: Float[np.ndarray, "n 2"], place: str) -> Float[np.ndarray, "n 2"]:
    """Invert the distortion of image points, in pixels."""
    seen = (points - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    plane = _fisheye_plane(lens, seen) if lens.is_fisheye else _iterated_plane(lens, seen, place)
    return plane * (lens.fx, lens.fy) + (lens.cx, lens.cy)


def _iterated_plane(lens: Lens, seen: Float[np.ndarray, "n 2"], place: str) -> Float[np.ndarray, "n 2"]:
    """Invert `distort` by fixed-point iteration."""
    plane = seen.copy()
    with np.errstate(all="ignore"):  # the check below detects divergence
        for _ in range(_SOLVER_STEPS):
            plane = (seen - _tangential_shift(lens, plane)) / _radial_factor(lens, plane)[:, None]
        error_px = np.abs((distort(lens, plane) - seen) * (lens.fx, lens.fy))
    if not (error_px < 0.05).all():
        raise InputError(
            f"{place}: its lens distortion has no inverse inside the image; check k1, k2, p1, p2 or undistort it."
        )
    return plane


def _fisheye_plane(lens: Lens, seen: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Invert `distort` of a fisheye. Rays beyond 89 degrees, or beyond the invertible angles, become the last one."""
    radii = _ANGLES * _polynomial(lens.radial, _ANGLES**2)
    falling = np.flatnonzero(np.diff(radii) <= 0)
    end = falling[0] + 1 if falling.size else len(radii)
    radius = np.linalg.norm(seen, axis=-1)
    slope = np.tan(np.interp(radius, radii[:end], _ANGLES[:end]))
    return seen * np.divide(slope, radius, out=np.ones_like(radius), where=radius > 0)[:, None]


def _radial_factor(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    r2 = (plane**2).sum(axis=-1)
    if lens.is_fisheye:
        r = np.sqrt(r2)
        angle = np.arctan(r)
        return np.divide(angle, r, out=np.ones_like(r), where=r > 0) * _polynomial(lens.radial, angle**2)
    factor = _polynomial(lens.radial, r2)
    return factor / _polynomial(lens.denominator, r2) if any(lens.denominator) else factor


def _polynomial(coefficients: tuple[float, ...], squares: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    return sum((k * squares ** (power + 1) for power, k in enumerate(coefficients)), start=np.ones_like(squares))


def _tangential_shift(lens: Lens, plane: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    p1, p2 = lens.tangential
    x, y = plane[..., 0], plane[..., 1]
    r2 = x**2 + y**2
    return np.stack((2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y), axis=-1)


def _reach(lens: Lens, focal: float, centre: float) -> tuple[float, float]:
    """Return the first and last position, in pixels, that an undistorted fisheye may show."""
    reach = focal * MAX_SLOPE if lens.is_fisheye else np.inf
    return centre - reach, centre + reach


def _bounded(low: float, high: float, length: int, reach: tuple[float, float], place: str) -> tuple[int, int]:
    """Return the first and last whole pixel inside [low, high], limited by MAX_GROWTH and `reach`."""
    margin = (MAX_GROWTH - 1) / 2 * length
    first = int(np.ceil(max(low, -margin, reach[0]) - 1e-6))
    last = int(np.floor(min(high, length + margin, reach[1]) + 1e-6))
    if last <= first:
        raise InputError(f"{place}: its lens distortion leaves no usable image; check k1, k2, p1, p2 or undistort it.")
    return first, last
