"""Cameras of two views from matched points: known cameras, a rectified pair, and a start in the wrong minimum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fecocodec.photographs.lens import Lens
from fecocodec.poses.estimated_cameras import (
    EstimatedCamera,
    ImageGroup,
    Reconstruction,
    angle_between,
    rotation_angle,
)
from fecocodec.poses.pose_warnings import reliability_warnings
from fecocodec.poses.two_photographs import reconstruct_pair
from fecocodec.poses.two_view_fit import TwoViewMatches, fit_two_views
from tests.poses import made_up_cameras

WIDTH, HEIGHT, FOCAL = 640, 480, 600.0


def camera(name: str, turn: float, position: tuple[float, float, float], focal: float = FOCAL) -> EstimatedCamera:
    return made_up_cameras.camera(name, Lens(WIDTH, HEIGHT, focal, focal, WIDTH / 2, HEIGHT / 2), position, turn)


def projections(cameras: tuple[EstimatedCamera, ...], noise_px: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels of 150 points that both cameras see, at depths of 3 to 9."""
    generator = np.random.default_rng(3)
    points = generator.uniform((-3, -2, 3), (3, 2, 9), (2000, 3))
    seen, pixels = np.ones(len(points), bool), []
    for one in cameras:
        found = made_up_cameras.pixels(one, points)
        depth = (points - one.camera_to_world[:3, 3]) @ one.camera_to_world[:3, 2]
        seen &= (depth > 0) & (found > 0).all(1) & (found < (WIDTH, HEIGHT)).all(1)
        pixels.append(found + generator.normal(0, noise_px, found.shape))
    return pixels[0][seen][:150], pixels[1][seen][:150]


def estimated(
    cameras: tuple[EstimatedCamera, ...],
    start: tuple[EstimatedCamera, ...],
    initial_px: float,
    *,
    known: bool = False,
    fixed: bool = False,
) -> tuple[Reconstruction, list[str]]:
    """Return the reconstruction of the projections from an estimate, and the warnings."""
    groups = [ImageGroup(("0", "1"), initial_px, is_known=known, is_fixed=fixed)]
    found = reconstruct_pair(Reconstruction(start, 0.3, 8.0, {}, (0.0, 0.0)), [start], projections(cameras), groups)
    return found, reliability_warnings(found, groups, found.cameras[0].lens.fx)


def test_turned_cameras_are_found_from_a_start_in_another_direction():
    """The start has the baseline along the optical axis and 0.85 of the focal length."""
    truth = camera("0", 0.0, (0, 0, 0)), camera("1", -20.0, (1.5, 0.1, 0.2))
    start = camera("0", 0.0, (0, 0, 0), 510.0), camera("1", -14.0, (0.1, 0.0, 1.0), 510.0)
    found, warnings = estimated(truth, start, 510.0)
    pose, known = found.cameras[1].camera_to_world, truth[1].camera_to_world
    assert rotation_angle(pose[:3, :3].T @ known[:3, :3]) < 0.5
    assert angle_between(pose[:3, 3], known[:3, 3]) < 1
    assert abs(found.cameras[0].lens.fx / FOCAL - 1) < 0.03
    assert np.linalg.norm(pose[:3, 3]) == pytest.approx(1)
    baseline = np.linalg.norm(known[:3, 3])
    assert np.percentile(found.cameras[0].depths, 1) * baseline > 2.5
    assert np.percentile(found.cameras[0].depths, 99) * baseline < 9.5
    assert 0.05 < found.reprojection_error_px < 0.25
    assert warnings == []


def test_a_rectified_pair_does_not_determine_the_focal_length():
    truth = camera("0", 0.0, (0, 0, 0)), camera("1", 0.0, (0.5, 0, 0))
    found, (warning,) = estimated(truth, truth, 480.0)
    assert found.cameras[0].lens.fx == pytest.approx(480, rel=0.05)  # stays where it started
    assert "two photographs do not determine their focal length here (" in warning
    assert "take a third and a fourth photograph from other positions" in warning
    low, high = found.ambiguity.zooms
    assert low <= 0.8 and high >= 1.6
    given, warnings = estimated(truth, truth, FOCAL, fixed=True)
    assert [one.lens.fx for one in given.cameras] == pytest.approx([FOCAL] * 2, rel=1e-12) and warnings == []
    assert angle_between(given.cameras[1].camera_to_world[:3, 3], truth[1].camera_to_world[:3, 3]) < 1


def test_exif_data_and_points_behind_a_camera_decide():
    # Cameras that turn little: the points tell less about the focal length than EXIF data does.
    truth = camera("0", 0.0, (0, 0, 0)), camera("1", -3.0, (0.5, 0, 0))
    zooms = [estimated(truth, truth, 480.0, known=known)[0].cameras[0].lens.fx / 480 for known in (False, True)]
    assert abs(zooms[1] - 1) < abs(zooms[0] - 1)
    assert abs(zooms[1] - 1) < 0.1
    truth = camera("0", 0.0, (0, 0, 0)), camera("1", -20.0, (1.5, 0.1, 0.2))
    reversed_ = replace(truth[1], camera_to_world=camera("1", -20.0, (-1.5, -0.1, -0.2)).camera_to_world)
    found, _ = estimated(truth, (truth[0], reversed_), FOCAL)
    assert angle_between(found.cameras[1].camera_to_world[:3, 3], truth[1].camera_to_world[:3, 3]) < 1


def test_cameras_that_hardly_turn_are_found_from_a_start_that_is_turned_far():
    """Of a wall, with a known focal length: all directions from the start's rotation end in another minimum."""
    generator = np.random.default_rng(1)
    wall = generator.uniform((-3, -2, 5), (3, 2, 5), (600, 3))
    wall[:, 2] += 0.4 * wall[:, 0]
    turn, direction = Rotation.from_euler("y", -3, degrees=True).as_matrix(), np.array((-0.99, 0.04, 0.1))
    first, second = (
        FOCAL * points[:, :2] / points[:, 2:] + generator.normal(0, 0.3, (600, 2))
        for points in (wall, wall @ turn.T + 0.5 * direction)
    )
    is_seen = (np.abs(np.hstack((first, second))) < (320, 240, 320, 240)).all(axis=1)
    matches = TwoViewMatches(first[is_seen][:150], second[is_seen][:150], (FOCAL, FOCAL), 0.3, is_focal_fixed=True)
    turned = Rotation.from_euler("y", 35, degrees=True).as_matrix() @ turn
    found = fit_two_views(matches, [matches.with_cost(turned, np.array((0.0, 0.6, 0.8)), 1.0)])[0]
    assert rotation_angle(found.rotation.T @ turn) < 0.5
    assert angle_between(found.direction, direction) < 2
