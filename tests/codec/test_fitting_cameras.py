"""The cameras of a whole capture are adjusted before photographs are chosen by them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.camera_files.find import read_cameras
from fecocodec.codec.encode_folder import encode_folder
from fecocodec.codec.fitting_cameras import with_fitting_cameras
from fecocodec.codec.options import EncodingOptions
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph
from fecocodec.evaluation.stress.perturbations import turned
from fecocodec.geometry.views import Views
from tests.example_scenes import write_views

pytestmark = pytest.mark.usefixtures("found_once")
COUNT, DEGREES = 7, 3.0


@pytest.fixture(scope="module")
def views() -> Views:
    poses = torch.stack([look((0.08 * step - 0.32, 0.02 * step, -1.5)) for step in range(COUNT)])
    return photograph(Room(painted), poses, (96, 96))


@pytest.fixture(scope="module")
def wrong(views: Views, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wrong") / "scene"
    write_views(folder, turned(views, DEGREES, COUNT))
    return folder


def errors_in_degrees(found: list[np.ndarray], views: Views) -> np.ndarray:
    """Return the angles between directions, each seen from the first camera, and those of the right cameras."""
    right = views.cameras.extrinsics.double().numpy()[:, :3, :3]
    of_found = np.stack(found)[:, :3, :3]
    between = np.swapaxes(of_found[0].T @ of_found, 1, 2) @ (right[0].T @ right)
    return np.degrees(np.arccos(np.clip((np.trace(between, axis1=1, axis2=2) - 1) / 2, -1, 1)))


def test_right_cameras_stay(views: Views, tmp_path: Path) -> None:
    write_views(tmp_path / "scene", views)
    scene = read_cameras(tmp_path / "scene")
    assert with_fitting_cameras(scene, "leave-out") == (scene, None)


def test_all_cameras_are_adjusted_but_that_of_a_broken_photograph(wrong: Path, views: Views) -> None:
    scene = read_cameras(wrong)
    given = [photograph.camera_to_world for photograph in scene.photographs]
    assert errors_in_degrees(given, views)[1:].min() > 0.5
    found, better = with_fitting_cameras(scene, "leave-out")
    assert better is not None and better.remark.startswith("the cameras do not fit the photographs")
    assert errors_in_degrees([photograph.camera_to_world for photograph in found.photographs], views).max() < 0.5
    spoiled = replace(scene.photographs[4], path=wrong / "transforms.json")
    broken = replace(scene, photographs=[*scene.photographs[:4], spoiled, *scene.photographs[5:]])
    rest, better = with_fitting_cameras(broken, "leave-out")
    assert better is not None
    assert rest.photographs[4].camera_to_world is given[4]
    assert rest.photographs[3].camera_to_world is not given[3]


def test_nothing_is_read_where_nothing_is_chosen(wrong: Path) -> None:
    scene = read_cameras(wrong)
    four = replace(scene, photographs=scene.photographs[:4])
    assert with_fitting_cameras(four, "leave-out") == (four, None)


@pytest.mark.usefixtures("uncoded")
def test_as_many_photographs_are_chosen_as_with_right_cameras(wrong, views, tmp_path, random_weights) -> None:
    write_views(tmp_path / "scene", views)
    options = EncodingOptions(effort="fast", num_stages=1, is_measured=False, num_checks=0)
    right, found = (encode_folder(folder, options) for folder in (tmp_path / "scene", wrong))
    assert len(found.names) == len(right.names) and len(found.guides.names) == len(right.guides.names)
    assert sum(note.startswith("the cameras do not fit") for note in found.notes) == 1
