"""The vertical of a scene is recovered from cameras that were all tilted by a known rotation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fecocodec.geometry.upright import to_upright_frame, vertical

TRUE_UP = np.array([0.0, -1.0, 0.0])
RING = range(0, 360, 45)


def cameras(heading_pitch_roll: list[tuple[float, float, float]], tilt: Rotation) -> np.ndarray:
    """Return poses of cameras with these angles in degrees (pitch: above the horizon), tilted together."""
    poses = np.tile(np.eye(4), (len(heading_pitch_roll), 1, 1))
    poses[:, :3, :3] = (tilt * Rotation.from_euler("YXZ", heading_pitch_roll, degrees=True)).as_matrix()
    poses[:, :3, 3] = np.arange(3 * len(poses)).reshape(-1, 3)
    return poses


def degrees_between(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(first @ second, -1, 1))))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "angles",
    [
        [(-10, 0, 0), (0, 0, 0), (10, 0, 0)],
        [(-20, -25, 0), (-5, 10, 0), (10, -5, 0), (25, 15, 0)],
        [(heading, -30, 0) for heading in RING],
        [(heading, -65, 0) for heading in RING],
        [(heading, -20, (-1) ** (heading // 45)) for heading in RING],
        [*((heading, 0, 0) for heading in (-20, -5, 5, 20, 35)), (0, 0, 90)],
        [*((heading, 0, 0) for heading in (-20, -5, 5, 20)), (0, 0, 180)],
    ],
    ids=["level", "pitched", "ring that looks down", "steep ring", "hand-held ring", "one on its side", "one inverted"],
)
def test_the_vertical_is_recovered_within_a_degree(angles: list[tuple[float, float, float]], seed: int) -> None:
    tilt = Rotation.random(random_state=seed)
    found = vertical(cameras(angles, tilt))
    assert found.is_agreed
    assert degrees_between(found.up, tilt.apply(TRUE_UP)) < 1


def test_one_camera_has_its_own_up() -> None:
    pose = cameras([(20, -35, 15)], Rotation.identity())
    found = vertical(pose)
    assert found.is_agreed
    np.testing.assert_allclose(found.up, -pose[0, :3, 1], atol=1e-12)


@pytest.mark.parametrize(
    "angles", [[(heading, -90, 0) for heading in RING], [(0, 0, 0), (5, 0, 180)]], ids=["down", "opposite"]
)
def test_cameras_that_do_not_agree_leave_it_to_the_first(angles: list[tuple[float, float, float]]) -> None:
    poses = cameras(angles, Rotation.random(random_state=1))
    found = vertical(poses)
    assert not found.is_agreed
    assert np.array_equal(found.up, -poses[0, :3, 1])


@pytest.mark.parametrize("angles", [(40, -30, 0), (0, 0, 90), (70, -90, 0)], ids=["pitched", "on its side", "down"])
def test_the_first_camera_is_at_the_origin_of_the_upright_frame(angles: tuple[float, float, float]) -> None:
    poses = cameras([angles], Rotation.random(random_state=2))
    up = Rotation.random(random_state=2).apply(TRUE_UP)
    pose = to_upright_frame(poses, up)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(pose[:3, :3] @ up, TRUE_UP, atol=1e-12)
    moved = pose @ poses[0]
    np.testing.assert_allclose(moved[:3, 3], 0, atol=1e-12)
    assert moved[2, 2] > -1e-9 and abs(moved[0, 2]) < 1e-9
