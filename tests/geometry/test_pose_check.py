"""Points that look alike, and whether cameras agree with them."""

import pytest
import torch

from fecocodec.evaluation.stress.box_room import Room, painted, photograph, sideways
from fecocodec.geometry.pose_check import fit_of
from fecocodec.geometry.sparse_matches import find_corners, match_corners
from tests.turned_cameras import with_turned_camera

SIDE, RIGHT, DOWN = 128, 12, 8  # pixels


def shifted_pair() -> tuple[torch.Tensor, torch.Tensor]:
    """Two parts of one picture: what is at (x, y) in the first is at (x - RIGHT, y - DOWN) in the second."""
    scene = photograph(Room(painted), sideways(), (SIDE + DOWN, SIDE + RIGHT)).images[0]
    return scene[:, :SIDE, :SIDE], scene[:, DOWN:, RIGHT:]


def test_corners_of_a_shifted_picture_match() -> None:
    first, second = match_corners(*(find_corners(image, None) for image in shifted_pair()))
    error = ((first - second) * SIDE - torch.tensor([RIGHT, DOWN])).abs().amax(dim=1)
    assert len(error) > 50 and float((error < 1.0).float().mean()) > 0.9


def test_masks_and_plain_walls_have_no_corners() -> None:
    image, _ = shifted_pair()
    assert len(find_corners(torch.full((3, SIDE, SIDE), 0.5), None).positions) == 0
    ignored = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    ignored[:, : SIDE // 2] = True
    left = find_corners(image, ignored).positions[:, 0]
    assert len(left) > 20 and float(left.min()) >= 0.5
    empty, full = find_corners(image, ~torch.zeros_like(ignored)), find_corners(image, None)
    assert [len(points) for points in match_corners(empty, full)] == [0, 0]


@pytest.mark.parametrize("degrees", [2.0, 6.0, 15.0])
def test_the_turn_of_a_camera_is_found(degrees: float) -> None:
    views = photograph(Room(painted), sideways(), (SIDE, SIDE)).select([0, 1])
    first, second = match_corners(*(find_corners(image, None) for image in views.images))
    right = fit_of(first, second, views.cameras)
    assert right.is_right and not right.has_reversed_axes and right.degrees < 1.0
    wrong = fit_of(first, second, with_turned_camera(views, 1, degrees).cameras)
    assert wrong.is_turned and not wrong.is_right
    assert wrong.degrees == pytest.approx(degrees, abs=0.7) and wrong.turned > 0.9 * right.given


def test_few_points_say_nothing() -> None:
    views = photograph(Room(painted), sideways(), (SIDE, SIDE)).select([0, 1])
    for count in (0, 3):
        points = torch.rand(count, 2, generator=torch.Generator().manual_seed(0))
        fit = fit_of(points, points, views.cameras)
        assert fit.count == count and not (fit.is_right or fit.is_turned or fit.has_reversed_axes)
