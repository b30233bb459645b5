"""Wrong cameras are adjusted until points meet; right ones, and those that cannot be mended, stay as they are."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.codec.encode_views import read_photographs
from fecocodec.codec.messages import Messages
from fecocodec.codec.options import EncodingOptions
from fecocodec.evaluation.stress.box_room import Room, along_a_line, chequered, painted, photograph
from fecocodec.evaluation.stress.perturbations import turned
from fecocodec.geometry.bundle_adjustment import adjusted
from fecocodec.geometry.sparse_matches import corners_of
from fecocodec.geometry.views import Views
from fecocodec.sender.input_warnings import check_input
from tests.example_scenes import write_views


@pytest.fixture(scope="module")
def views() -> Views:
    return photograph(Room(painted), along_a_line(4), (160, 160))


def between(extrinsics: Tensor) -> Tensor:
    """Return the poses of all cameras seen from the first."""
    return torch.linalg.inv(extrinsics[:1]) @ extrinsics


def largest_angle(first: Tensor, second: Tensor) -> float:
    """Return the largest angle in degrees between the directions of two sets of poses."""
    cosine = ((first[:, :3, :3] * second[:, :3, :3]).sum(dim=(1, 2)) - 1) / 2
    return math.degrees(float(cosine.clamp(-1, 1).acos().max()))


def test_right_cameras_stay(views: Views) -> None:
    corners = corners_of(views.images, views.ignored)
    assert adjusted(views.cameras, corners) is None
    assert adjusted(views.select([0]).cameras, corners[:1]) is None


@pytest.mark.parametrize("degrees", [0.5, 5.0])
def test_turned_cameras_get_back_what_they_see_in_common(views: Views, degrees: float) -> None:
    wrong = turned(views, degrees, len(views.images))
    right = between(views.cameras.extrinsics)
    assert largest_angle(between(wrong.cameras.extrinsics), right) > degrees
    found = adjusted(wrong.cameras, corners_of(views.images, views.ignored))
    assert found is not None
    assert 0.7 * degrees < found.degrees < 1.5 * degrees
    assert found.error < 1.0
    assert largest_angle(between(found.cameras.extrinsics), right) < 0.1 * degrees + 0.2
    torch.testing.assert_close(found.cameras.intrinsics, views.cameras.intrinsics)


def test_fixed_cameras_stay_and_others_are_adjusted_to_them(views: Views) -> None:
    """As photographs that are only measured."""
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[3:] = turned(views, 3.0, len(views.images)).cameras.extrinsics[3:]
    wrong, corners = replace(views.cameras, extrinsics=extrinsics), corners_of(views.images, views.ignored)
    found = adjusted(wrong, corners, num_fixed=3)
    assert found is not None
    assert torch.equal(found.cameras.extrinsics[:3], views.cameras.extrinsics[:3])
    assert largest_angle(found.cameras.extrinsics, views.cameras.extrinsics) < 0.3
    assert adjusted(wrong, corners, num_fixed=5) is None


def test_cameras_of_other_photographs_stay(views: Views) -> None:
    mixed = replace(views.cameras, extrinsics=views.cameras.extrinsics.flip(0))
    assert adjusted(mixed, corners_of(views.images, views.ignored)) is None


def test_right_cameras_of_a_repeated_pattern_stay() -> None:
    """Its corners look alike one period further on, where a turned camera would see them; plane sweeps contradict."""
    pattern = photograph(Room(chequered), along_a_line(3)[:2], (256, 256))
    corners = corners_of(pattern.images, pattern.ignored)
    assert adjusted(pattern.cameras, corners) is not None
    assert adjusted(pattern.cameras, corners, photographs=pattern) is None


def test_few_points_say_nothing(views: Views) -> None:
    wrong = turned(views, 2.0, len(views.images)).cameras
    ignored = torch.ones(views.images[:, 0].shape, dtype=torch.bool)
    ignored[:, :50, :50] = False
    assert adjusted(wrong, corners_of(views.images, ignored)) is None
    assert adjusted(wrong, corners_of(views.images, None)) is not None
    blank = torch.full_like(views.images, 0.5)
    assert adjusted(wrong, corners_of(blank, None)) is None


@pytest.mark.usefixtures("found_once")
@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_turned_cameras_of_a_folder_are_adjusted_and_that_is_said(views: Views, degrees: float, tmp_path: Path) -> None:
    write_views(tmp_path, turned(views, degrees, len(views.images)))
    messages = Messages(tmp_path)
    context, guides = (choose_photographs(tmp_path, views=names) for names in ((0, 1, 2), (3, 4)))
    read = read_photographs(context, guides, None, EncodingOptions(), messages)
    is_said = any(note.startswith("the cameras do not fit the photographs") for note in messages.notes)
    assert is_said == (degrees > 0.0)
    assert not any("turned by" in warning for warning in check_input(read.views, "fast", read.guides))
    assert (read.views.names, read.guides.names) == (("0.png", "1.png", "2.png"), ("3.png", "4.png"))
    found = torch.cat((read.views.cameras.extrinsics, read.guides.cameras.extrinsics))
    assert largest_angle(between(found), between(views.cameras.extrinsics)) < 0.4
