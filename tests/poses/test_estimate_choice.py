"""Which estimate is kept: made-up estimates of known cameras, and matches of points that the cameras see."""

from dataclasses import replace

import numpy as np
import pytest

from fecocodec.photographs.lens import Lens
from fecocodec.poses.estimate_choice import Estimate, best_estimate, least_difference, match_cost
from fecocodec.poses.estimated_cameras import EstimatedCamera
from fecocodec.poses.pycolmap_matching import reached_points
from tests.poses.made_up_cameras import camera, pixels

LENS = Lens(640, 480, 900.0, 900.0, 320.0, 240.0, radial=(0.2,))


def cameras_of(turn: float = 0.0, lens: Lens = LENS) -> tuple[EstimatedCamera, ...]:
    """Return four cameras in a row. turn: of the last about the vertical axis, in degrees."""
    return tuple(camera(str(index), lens, (0.3 * index, 0, 0), turn if index == 3 else 0.0) for index in range(4))


def matches_of(cameras: tuple[EstimatedCamera, ...]) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    world = np.random.default_rng(0).uniform((-1, -1, 5), (2, 1, 9), (300, 3))
    seen = [pixels(of, world) for of in cameras]
    return {(str(one), str(other)): (seen[one], seen[other]) for other in range(4) for one in range(other)}


POINTS = matches_of(cameras_of())
RIGHT, WRONG = Estimate(cameras_of(), "right"), Estimate(cameras_of(turn=8.0), "wrong")


@pytest.mark.parametrize("estimates", [[RIGHT, WRONG], [WRONG, RIGHT]])
def test_of_equally_many_cameras_those_that_explain_the_matches_are_kept(estimates: list[Estimate]):
    """The number of points and the reprojection error would not tell: they count explained matches only."""
    assert best_estimate(estimates, POINTS) is RIGHT
    everything = RIGHT.names
    assert match_cost(RIGHT, everything, POINTS) < 1e-6 < 1 < match_cost(WRONG, everything, POINTS)


def test_which_estimate_is_kept():
    fewer = replace(RIGHT, cameras=RIGHT.cameras[:3])
    assert best_estimate([fewer, WRONG], POINTS) is WRONG
    assert best_estimate([WRONG, fewer], POINTS) is WRONG
    first, second = (replace(RIGHT, cameras=RIGHT.cameras[part]) for part in (slice(2), slice(2, 4)))
    assert best_estimate([first, second], POINTS) is first
    assert best_estimate([second, first], POINTS) is second
    assert best_estimate([RIGHT, Estimate(cameras_of(), "again")], POINTS) is RIGHT
    straight = Estimate(cameras_of(lens=replace(LENS, radial=(0.0,))), "straight")
    assert match_cost(RIGHT, RIGHT.names, POINTS) < 1e-6
    assert best_estimate([straight, RIGHT], POINTS) is RIGHT
    # Cameras in the opposite order have the same epipolar lines, and all points behind them.
    flipped = [camera.camera_to_world * np.where(np.arange(16).reshape(4, 4) == 3, -1, 1) for camera in RIGHT.cameras]
    behind = [replace(camera, camera_to_world=pose) for camera, pose in zip(RIGHT.cameras, flipped, strict=True)]
    assert best_estimate([Estimate(tuple(behind), "behind"), RIGHT], POINTS) is RIGHT
    near = Estimate(cameras_of(turn=0.5), "near")
    assert least_difference(RIGHT, [WRONG, RIGHT, near]) == pytest.approx((0.5, 0.5), abs=0.01)
    assert least_difference(RIGHT, [RIGHT, replace(RIGHT, cameras=RIGHT.cameras[:2])]) is None


def test_features_that_match_reconstructed_points_are_counted():
    """Photograph c has three matches with a: one twice, and one of a feature without a point."""

    class Image:
        def __init__(self, name: str, has_point: list[bool]) -> None:
            self.name = name
            self.points2D = [type("Point", (), {"has_point3D": lambda self, has=has: has})() for has in has_point]

    images = {1: Image("a", [True, False, True]), 2: Image("b", [True])}
    model = type("Model", (), {"reg_image_ids": lambda self: [1, 2], "image": lambda self, number: images[number]})()
    matches = {("a", "b"): [[0, 0]], ("a", "c"): [[0, 7], [1, 8], [2, 9]], ("b", "c"): [[0, 7]], ("c", "d"): [[1, 1]]}
    found = reached_points(model, {pair: np.array(numbers) for pair, numbers in matches.items()})
    assert found == {"c": 2}
