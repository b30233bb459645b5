"""Fit the relative pose and the focal length of two photographs to matched points, from many starting directions.

The epipolar error of two views has several minima: a small rotation looks much like a sideways shift, and a plane has
two solutions. It is also nearly constant in the focal length if the optical axes are nearly parallel or the points are
nearly on a plane. So the fit starts from directions in all of a hemisphere, and a weak prior keeps the focal length
near its initial value where the matches do not determine it.

Error: Sampson distance (Hartley and Zisserman, "Multiple View Geometry", 11.4.3) with a Cauchy loss.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fecocodec.poses.estimated_cameras import rotation_angle

LOSS_SCALE_PX = 0.5
_NUM_DIRECTIONS = 16
_MOST_EVALUATIONS = 60
_FOCAL_STEPS = ((0.9, 0.8, 0.7, 0.6, 0.5), (1.1, 1.25, 1.4, 1.6, 2.0))  # away from the fitted focal length
_MOST_RESTARTS = 3
_MOST_LOG_ZOOM = np.log(4.0)  # of the initial focal length, in both directions
_SAME_ROTATION = 5.0  # degrees; starts that differ by less share their starting directions

Points = Float[np.ndarray, "match 2"]
Rotations = Float[np.ndarray, "3 3"]
Direction = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class TwoViewFit:
    """Pose of the second camera relative to the first: x_second = rotation @ x_first + direction, a unit vector.

    zoom: focal lengths, relative to the initial ones. cost: sum over matches of the robust squared errors.
    """

    rotation: Rotations
    direction: Direction
    zoom: float
    cost: float


@dataclass(frozen=True)
class TwoViewMatches:
    """Matched points of two views in pixels from the principal points, and their initial focal lengths in pixels.

    prior: strength of the prior on the focal length. A zoom z multiplies the cost by 1 + prior * log(z)^2.
    is_focal_fixed: whether the initial focal lengths are kept.
    """

    first: Points
    second: Points
    focal_px: tuple[float, float]
    prior: float
    is_focal_fixed: bool = False

    def rays(self, zoom: float) -> tuple[Float[np.ndarray, "match 3"], Float[np.ndarray, "match 3"]]:
        """Return the rays of both views in camera axes, with z = 1."""
        ones = np.ones((len(self.first), 1))
        scale_first, scale_second = (zoom * focal for focal in self.focal_px)
        return np.hstack((self.first / scale_first, ones)), np.hstack((self.second / scale_second, ones))

    def errors_px(self, rotation: Rotations, direction: Direction, zoom: float) -> Float[np.ndarray, " match"]:
        """Return the signed Sampson distances."""
        x, y, z = direction
        essential = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0))) @ rotation
        focal_first, focal_second = (zoom * focal for focal in self.focal_px)
        first, second = self.first.T / focal_first, self.second.T / focal_second
        lines_first = essential[:2].T @ second + essential[2][:, None]
        lines_second = essential[:, :2] @ first + essential[:, 2:]
        slope_first = (lines_first[0] ** 2 + lines_first[1] ** 2) / focal_first**2
        slope_second = (lines_second[0] ** 2 + lines_second[1] ** 2) / focal_second**2
        distances = second[0] * lines_second[0] + second[1] * lines_second[1] + lines_second[2]
        errors: Float[np.ndarray, " match"] = distances / np.sqrt(slope_first + slope_second + 1e-18)
        return errors

    def depths(self, fit: TwoViewFit) -> tuple[Float[np.ndarray, " match"], Float[np.ndarray, " match"]]:
        """Return the depths of the points in both views, in baselines; negative behind a camera.

        A point is where the two rays are closest. Parallel rays give large numbers of either sign.
        """
        first, second = self.rays(fit.zoom)
        first = first @ fit.rotation.T
        aa, ab, bb = (first**2).sum(1), (first * second).sum(1), (second**2).sum(1)
        a, b = first @ fit.direction, second @ fit.direction
        determinant = aa * bb - ab**2 + 1e-15
        return (ab * b - bb * a) / determinant, (aa * b - ab * a) / determinant

    def with_cost(self, rotation: Rotations, direction: Direction, zoom: float) -> TwoViewFit:
        """Return the fit with its cost."""
        errors = self.errors_in_front_px(rotation, direction, zoom)
        cost = LOSS_SCALE_PX**2 * np.log1p((errors / LOSS_SCALE_PX) ** 2).sum()
        return TwoViewFit(rotation, direction, zoom, float(cost))

    def errors_in_front_px(self, rotation: Rotations, direction: Direction, zoom: float) -> Float[np.ndarray, " match"]:
        """Return the Sampson distances. A point behind a camera has at least the error of a point at infinity."""
        errors = np.abs(self.errors_px(rotation, direction, zoom))
        turned = self.rays(zoom)[0] @ rotation.T
        front = turned[:, 2] > 1e-6
        at_infinity = np.full(len(errors), np.inf)
        at_infinity[front] = np.linalg.norm(
            turned[front, :2] / turned[front, 2:] * zoom * self.focal_px[1] - self.second[front], axis=1
        )
        depths = self.depths(TwoViewFit(rotation, direction, zoom, 0.0))
        is_behind = (depths[0] < 0) | (depths[1] < 0)
        return np.where(is_behind, np.maximum(errors, np.minimum(at_infinity / np.sqrt(2), 1e6)), errors)

    def penalised(self, fit: TwoViewFit) -> float:
        """Return the cost with the prior on the focal length."""
        return float(fit.cost * (1 + self.prior * np.log(fit.zoom) ** 2))


def fit_two_views(matches: TwoViewMatches, starts: list[TwoViewFit]) -> list[TwoViewFit]:
    """Return the minima of the penalised cost that are reached, best first; at least one.

    starts: at least one estimate. The fit starts from each, and with its rotation from directions in a hemisphere.
    It starts from cameras that are not turned, too: those of an estimate can be turned far in error.
    """
    starts = [*starts, matches.with_cost(np.eye(3), np.array((1.0, 0.0, 0.0)), 1.0)]
    weight = None if matches.is_focal_fixed else matches.prior * min(start.cost for start in starts)
    found = list(starts)
    for number, start in enumerate(starts):
        found += _fits(matches, start, weight)
        if all(rotation_angle(start.rotation.T @ other.rotation) > _SAME_ROTATION for other in starts[:number]):
            for direction in _hemisphere():
                found += _fits(matches, TwoViewFit(start.rotation, direction, 1.0, 0.0), weight)
    best = min(found, key=matches.penalised)
    # The valley along the focal length is curved, and a fit can stop in it.
    for _ in range(0 if matches.is_focal_fixed else _MOST_RESTARTS):
        other = min(vary_focal_length(matches, best).values(), key=matches.penalised)
        if matches.penalised(other) > 0.999 * matches.penalised(best):
            break
        best = min([other, *_fits(matches, other, matches.prior * other.cost)], key=matches.penalised)
    return [best, *sorted(found, key=matches.penalised)]


def vary_focal_length(matches: TwoViewMatches, fit: TwoViewFit) -> dict[float, TwoViewFit]:
    """Return the best fits with other focal lengths, by their ratio to that of `fit`; none if they are fixed."""
    found: dict[float, TwoViewFit] = {}
    for steps in () if matches.is_focal_fixed else _FOCAL_STEPS:
        current = fit
        for step in steps:
            start = TwoViewFit(current.rotation, current.direction, fit.zoom * step, 0.0)
            current = min(_fits(matches, start, None), key=lambda one: one.cost)
            found[step] = current
    return found


def _fits(matches: TwoViewMatches, start: TwoViewFit, prior_weight: float | None) -> list[TwoViewFit]:
    """Return the minimum from a start, with both signs of the direction. prior_weight: None keeps the focal length."""
    tangents = np.linalg.svd(start.direction[None])[2][1:]

    def unpack(steps: Float[np.ndarray, " step"]) -> tuple[Rotations, Direction, float]:
        direction = start.direction + steps[3:5] @ tangents
        zoom = start.zoom
        if prior_weight is not None:
            zoom = float(np.exp(np.clip(np.log(zoom) + steps[5], -_MOST_LOG_ZOOM, _MOST_LOG_ZOOM)))
        rotation = Rotation.from_rotvec(steps[:3]).as_matrix() @ start.rotation
        return rotation, direction / np.linalg.norm(direction), zoom

    def residuals(steps: Float[np.ndarray, " step"]) -> Float[np.ndarray, " residual"]:
        rotation, direction, zoom = unpack(steps)
        return np.append(matches.errors_px(rotation, direction, zoom), np.sqrt(prior_weight or 0.0) * np.log(zoom))

    solution = least_squares(
        residuals,
        np.zeros(5 if prior_weight is None else 6),
        loss=_robust_but_for_the_last,
        f_scale=LOSS_SCALE_PX,
        max_nfev=_MOST_EVALUATIONS,
        x_scale="jac",
    )
    rotation, direction, zoom = unpack(solution.x)
    return [matches.with_cost(rotation, sign * direction, zoom) for sign in (1, -1)]


def _robust_but_for_the_last(squared: Float[np.ndarray, " residual"]) -> Float[np.ndarray, "3 residual"]:
    """Return the Cauchy loss and its derivatives; the last residual, the prior, has a quadratic loss."""
    loss = np.stack((np.log1p(squared), 1 / (1 + squared), -1 / (1 + squared) ** 2))
    loss[:, -1] = squared[-1], 1, 0
    return loss


def _hemisphere() -> Float[np.ndarray, "direction 3"]:
    """Return unit vectors that are evenly spread over the half sphere z > 0 (a spiral of golden angles)."""
    index = np.arange(_NUM_DIRECTIONS) + 0.5
    z = index / _NUM_DIRECTIONS
    angle, radius = np.pi * (1 + np.sqrt(5)) * index, np.sqrt(1 - z**2)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), z), axis=1)
