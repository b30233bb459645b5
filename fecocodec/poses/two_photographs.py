"""Cameras of two registered photographs: fitted from many starting directions, with what else fits the matches."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fecocodec.poses.estimated_cameras import Ambiguity, EstimatedCamera, ImageGroup, Reconstruction, angle_between
from fecocodec.poses.two_view_fit import Points, TwoViewFit, TwoViewMatches, fit_two_views, vary_focal_length

# Strength of the prior on the focal length (`TwoViewMatches`), without and with EXIF data. Twice the focal length has
# to lower the cost by 13%, 1.1 times that of EXIF data by 5%.
_PRIOR, _PRIOR_WITH_EXIF = 0.3, 5.5
# Shares by which the cost of another fit may be higher, so that it explains the matches nearly as well.
_SIMILAR_FOCAL, _SIMILAR_POSE = 0.02, 0.1
_MOST_MATCHES = 1000  # evenly chosen; more take time and hardly change the fit
_LARGEST_ERROR_PX, _SMALLEST_ANGLE = 4.0, 0.5  # of points, as in the reconstruction of more photographs


def reconstruct_pair(
    found: Reconstruction,
    starts: list[tuple[EstimatedCamera, ...]],
    points: tuple[Points, Points],
    groups: list[ImageGroup],
) -> Reconstruction:
    """Return the reconstruction of two photographs with the cameras that fit the matched points best.

    found: has two cameras. starts: estimates of both, at least one. points: matches in pixels, in the order of the
    cameras.
    """
    matches = _matches(found.cameras, points, groups)
    fit, *rest = fit_two_views(matches, [_start(matches, cameras) for cameras in starts])
    errors, depths = np.abs(matches.errors_px(fit.rotation, fit.direction, fit.zoom)), matches.depths(fit)
    angles = _angles(matches, fit)
    is_point = (errors < _LARGEST_ERROR_PX) & (depths[0] > 0) & (depths[1] > 0) & (angles > _SMALLEST_ANGLE)
    return replace(
        found,
        cameras=_cameras(found.cameras, fit, groups, (depths[0][is_point], depths[1][is_point])),
        # The Sampson distance is the correction of both points together.
        reprojection_error_px=float(errors[is_point].mean() / np.sqrt(2)) if is_point.any() else 0.0,
        angle=float(np.median(angles[is_point])) if is_point.any() else 0.0,
        difference=None,  # it is between estimates that only start the fit
        ambiguity=_ambiguity(matches, fit, rest),
    )


def _matches(
    cameras: tuple[EstimatedCamera, ...], points: tuple[Points, Points], groups: list[ImageGroup]
) -> TwoViewMatches:
    chosen = np.linspace(0, len(points[0]) - 1, min(len(points[0]), _MOST_MATCHES)).round().astype(int)
    first, second = (
        one[chosen] - (camera.lens.cx, camera.lens.cy) for one, camera in zip(points, cameras, strict=True)
    )
    is_known, is_fixed = all(group.is_known for group in groups), all(group.is_fixed for group in groups)
    prior = _PRIOR_WITH_EXIF if is_known else _PRIOR
    return TwoViewMatches(first, second, _initial_focals(cameras, groups), prior, is_fixed)


def _initial_focals(cameras: tuple[EstimatedCamera, ...], groups: list[ImageGroup]) -> tuple[float, float]:
    focal_of = {name: group.focal_px for group in groups for name in group.names}
    return focal_of[cameras[0].name], focal_of[cameras[1].name]


def _start(matches: TwoViewMatches, cameras: tuple[EstimatedCamera, ...]) -> TwoViewFit:
    """Return an estimate of pycolmap as a fit; two different focal lengths become one zoom."""
    pose = np.linalg.inv(cameras[1].camera_to_world) @ cameras[0].camera_to_world
    zooms = [camera.lens.fx / focal for camera, focal in zip(cameras, matches.focal_px, strict=True)]
    return matches.with_cost(
        pose[:3, :3], pose[:3, 3] / np.linalg.norm(pose[:3, 3]), float(np.sqrt(zooms[0] * zooms[1]))
    )


def _angles(matches: TwoViewMatches, fit: TwoViewFit) -> Float[np.ndarray, " match"]:
    """Return the angles between the rays of each match, in degrees."""
    first, second = matches.rays(fit.zoom)
    first, second = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (first @ fit.rotation.T, second))
    angles: Float[np.ndarray, " match"] = np.degrees(2 * np.arcsin(np.linalg.norm(first - second, axis=1) / 2))
    return angles


def _cameras(
    cameras: tuple[EstimatedCamera, ...],
    fit: TwoViewFit,
    groups: list[ImageGroup],
    depths: tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]],
) -> tuple[EstimatedCamera, ...]:
    """Return the cameras with the poses and focal lengths of a fit. The baseline is the unit of length."""
    world_to_second = np.eye(4)
    world_to_second[:3, :3], world_to_second[:3, 3] = fit.rotation, fit.direction
    poses = np.eye(4), np.linalg.inv(world_to_second)
    fitted = []
    for camera, pose, depth, focal in zip(cameras, poses, depths, _initial_focals(cameras, groups), strict=True):
        lens = replace(camera.lens, fx=focal * fit.zoom, fy=focal * fit.zoom, radial=())
        fitted.append(replace(camera, lens=lens, camera_to_world=pose, depths=depth))
    return tuple(fitted)


def _ambiguity(matches: TwoViewMatches, fit: TwoViewFit, rest: list[TwoViewFit]) -> Ambiguity:
    """Return how far the other minima, and fits with other focal lengths, differ from `fit`."""
    varied = vary_focal_length(matches, fit)
    zooms = [1.0, *(step for step, other in varied.items() if other.cost < (1 + _SIMILAR_FOCAL) * fit.cost)]
    similar = [other for other in (*rest, *varied.values()) if other.cost < (1 + _SIMILAR_POSE) * fit.cost]
    direction = max((angle_between(fit.direction, other.direction) for other in similar), default=0.0)
    return Ambiguity((min(zooms), max(zooms)), direction)
