"""A turn of the camera explains all matches of photographs from one position, and few of those from two."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fecocodec.poses.turned_camera import only_turned, turned_share

FOCAL = 600.0


def pixels(turn: float, position: tuple[float, float, float], depth: tuple[float, float], focal: float) -> np.ndarray:
    """Return 300 points as a camera sees them that is turned by `turn` degrees, with noise of 0.2 pixels."""
    generator = np.random.default_rng(0)
    points = generator.uniform((-2, -1.5, depth[0]), (2, 1.5, depth[1]), (300, 3))
    local = Rotation.from_euler("y", -turn, degrees=True).apply(points - np.array(position))
    return local[:, :2] / local[:, 2:] * focal + np.random.default_rng(int(turn) + 1).normal(0, 0.2, (300, 2))


def share(turn: float, position: tuple[float, float, float], depth: tuple[float, float], focal: float = FOCAL) -> float:
    first, second = pixels(0, (0, 0, 0), depth, focal), pixels(turn, position, depth, focal)
    return turned_share(first, second, (FOCAL, FOCAL))


@pytest.mark.parametrize(("turn", "focal"), [(0.0, FOCAL), (12.0, FOCAL), (12.0, 1.2 * FOCAL)])
def test_a_turn_explains_photographs_from_one_position(turn: float, focal: float) -> None:
    assert share(turn, (0, 0, 0), (3, 6), focal) > 0.9


@pytest.mark.parametrize("depth", [(3.0, 6.0), (4.0, 4.0)])
@pytest.mark.parametrize("turn", [0.0, 5.0])
def test_a_shift_by_a_tenth_of_the_depth_is_no_turn(turn: float, depth: tuple[float, float]) -> None:
    """Also in front of a wall, where a homography explains both."""
    assert share(turn, (0.4, 0, 0), depth) < 0.6


def test_one_photograph_from_another_position_is_enough_and_ends_the_search() -> None:
    positions = {"a": (0.0, 0.0, 0.0), "b": (0.4, 0.0, 0.0), "c": (0.0, 0.0, 0.0), "d": (0.0, 0.0, 0.0)}
    asked = []

    def matched(first: str, second: str) -> tuple[np.ndarray, np.ndarray]:
        asked.append(first + second)
        turn = {name: 3.0 * index for index, name in enumerate("abcd")}
        one, other = (pixels(turn[name], positions[name], (3, 6), FOCAL) for name in (first, second))
        return one, other

    focal_px = dict.fromkeys("abcd", FOCAL)
    assert not only_turned(list("abcd"), matched, focal_px)
    assert asked == ["ac", "bc"]  # the middle one with every other, the most distant first
    positions["b"] = (0.0, 0.0, 0.0)
    assert only_turned(list("abcd"), matched, focal_px)


def test_photographs_without_overlap_are_not_judged() -> None:
    few = np.zeros((29, 2)), np.zeros((29, 2))
    assert not only_turned(["a", "b"], lambda _first, _second: few, {"a": FOCAL, "b": FOCAL})
