"""Whether the matches of photographs fit a camera that only turned, so that they tell nothing about depth."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fecocodec.poses.two_view_fit import Points

# Largest error of a match that a turn explains, in pixels and in degrees; parallax of less gives no depth.
_ERROR_PX, _ERROR_DEGREES = 1.0, 0.25
# On 44 training scenes, a turn explained 0.84 or more of the matches of a drawn turn (with noise and JPEG artefacts),
# and at most 0.69 of those of neighbouring photographs, which are from different positions.
_LEAST_SHARE = 0.8
_LEAST_MATCHES = 30
_MOST_ZOOM = 1.25  # of the initial focal length, and its inverse: a long lens makes a shift look like a turn
_MOST_MATCHES = 1000


def only_turned(
    names: list[str], matched: Callable[[str, str], tuple[Points, Points]], focal_px: dict[str, float]
) -> bool:
    """Return whether turns of the camera explain nearly all matches of the middle photograph with every other.

    matched: returns matched points of two photographs, in pixels from the principal points; not called again after a
    pair that has few matches or was taken from two positions. focal_px: initial focal lengths. Photographs that the
    middle one does not overlap with are not compared with others, and the answer is then no. It can be yes for a wall
    without relief, seen from positions less than about 3 degrees apart.
    """
    middle = len(names) // 2
    for index in sorted(set(range(len(names))) - {middle}, key=lambda other: -abs(other - middle)):
        first, second = sorted((index, middle))
        points = matched(names[first], names[second])
        focals = focal_px[names[first]], focal_px[names[second]]
        if len(points[0]) < _LEAST_MATCHES or turned_share(*points, focals) < _LEAST_SHARE:
            return False
    return True


def turned_share(first: Points, second: Points, focal_px: tuple[float, float]) -> float:
    """Return the share of the matches that a turn of the camera explains, of any angle, including none.

    first, second: matched points in pixels from the principal points. focal_px: initial focal lengths, which share a
    factor that is fitted within _MOST_ZOOM.
    """
    chosen = np.linspace(0, len(first) - 1, min(len(first), _MOST_MATCHES)).round().astype(int)
    first, second = first[chosen], second[chosen]
    limit_px = min(_ERROR_PX, float(np.radians(_ERROR_DEGREES)) * min(focal_px))

    def errors(parameters: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "match 2"]:
        zoom = np.exp(parameters[3])
        rays = np.hstack((first / (zoom * focal_px[0]), np.ones((len(first), 1))))
        turned = Rotation.from_rotvec(parameters[:3]).apply(rays)
        depth = np.maximum(turned[:, 2:], 1e-3)
        difference: Float[np.ndarray, "match 2"] = turned[:, :2] / depth * zoom * focal_px[1] - second
        return difference

    limit = np.log(_MOST_ZOOM)
    start = np.append(_turn(first / focal_px[0], second / focal_px[1]), 0.0)
    bounds = ([-np.inf] * 3 + [-limit], [np.inf] * 3 + [limit])
    fit = least_squares(lambda one: errors(one).ravel(), start, bounds=bounds, loss="cauchy", f_scale=limit_px)
    return float((np.linalg.norm(errors(fit.x), axis=1) < limit_px).mean())


def _turn(first: Points, second: Points) -> Float[np.ndarray, " 3"]:
    """Return the rotation vector that aligns the rays of the matches best. Points are on the plane z = 1."""
    rays = [np.hstack((one, np.ones((len(one), 1)))) for one in (first, second)]
    vector: Float[np.ndarray, " 3"] = Rotation.align_vectors(rays[1], rays[0])[0].as_rotvec()
    return vector
