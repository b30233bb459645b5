"""Views chosen from poses overlap with their neighbours, keep a baseline, and cover the middle of a capture.

Choose views by index or by name.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs
from fecocodec.captures.view_choice import choose_views
from fecocodec.captures.view_spread import auto_views, spread_views
from fecocodec.errors import InputError
from fecocodec.geometry.frustum_overlap import covisibility_estimate
from fecocodec.photographs.images import write_image
from fecocodec.photographs.lens import Lens

LENS = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
NEAR, FAR = 2.0, 10.0


def walk(count: int = 40, step: float = 0.5) -> np.ndarray:
    """Cameras side by side along a street, all looking at its other side."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = step * np.arange(count)
    return poses


def orbit(count: int = 36, radius: float = 4.0) -> np.ndarray:
    """Cameras on a full circle, looking at its centre."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("y", 360 / count * np.arange(count)[:, None], degrees=True).as_matrix()
    poses[:, :3, 3] = -radius * poses[:, :3, 2]
    return poses


@pytest.fixture
def scene_of(tmp_path: Path):
    def make(poses: np.ndarray, near: float | None = NEAR, far: float | None = FAR, depths=()) -> PosedPhotographs:
        image = tmp_path / "image.png"
        write_image(image, torch.zeros(3, 64, 64), overwrite=True)
        photographs = [
            PosedPhotograph(
                image, f"{n}", pose, lambda w, h: Lens(w, h, float(w), float(h), w / 2, h / 2), np.array(depths, float)
            )
            for n, pose in enumerate(poses)
        ]
        return PosedPhotographs(tmp_path, photographs, near, far)

    return make


def nearest_overlaps(poses: np.ndarray, chosen: tuple[int, ...]) -> np.ndarray:
    lenses = np.tile(LENS, (len(chosen), 1, 1))
    overlap = covisibility_estimate(poses[list(chosen)], lenses, NEAR, FAR)
    np.fill_diagonal(overlap, 0.0)
    return overlap.max(axis=1)


@pytest.mark.parametrize("make", [walk, orbit])
@pytest.mark.parametrize("count", [2, 4, 8])
def test_neighbours_overlap_by_half_or_more(scene_of, make, count):
    poses = make()
    chosen = spread_views(scene_of(poses), count)
    assert len(set(chosen)) == count and list(chosen) == sorted(chosen)
    assert nearest_overlaps(poses, chosen).min() >= 0.5


def test_the_middle_is_covered_as_widely_as_overlap_allows(scene_of):
    chosen = spread_views(scene_of(walk(40, step=0.1)), 4)
    assert chosen[0] < 20 <= chosen[-1]
    assert np.diff(chosen).min() > 1, "neighbours farther apart would overlap enough too"


def test_how_many_are_taken(scene_of):
    assert spread_views(scene_of(walk(3)), 3) == (0, 1, 2)
    assert auto_views(scene_of(walk(3))) == (0, 1, 2)
    poses = walk(30)
    assert len(auto_views(scene_of(poses))) == 8
    poses[:27, 0, 3] += 1000 * np.arange(1, 28)  # only the last three stand together
    assert auto_views(scene_of(poses)) == (27, 28, 29)
    with pytest.raises(InputError, match="17 views asked for, but at most 16 can be used"):
        spread_views(scene_of(walk(20)), 17)


def test_cameras_at_one_position_are_not_neighbours_where_others_are(scene_of):
    poses = walk(5).repeat(4, axis=0)
    chosen = spread_views(scene_of(poses), 5)
    assert len({tuple(poses[index, :3, 3]) for index in chosen}) == 5


@pytest.mark.parametrize("depths", [(), tuple(np.linspace(2, 10, 50))])
def test_without_bounds_they_come_from_points_or_from_steps_of_the_camera(scene_of, depths):
    poses = walk()
    chosen = spread_views(scene_of(poses, None, None, depths), 4)
    assert nearest_overlaps(poses, chosen).min() >= 0.3


@pytest.mark.parametrize("count", [0, 11])
def test_more_views_than_there_are(scene_of, count):
    with pytest.raises(InputError, match=f"{count} views asked for, but the folder has 10; choose 1 to 10"):
        spread_views(scene_of(walk(10)), count)


def test_opposite_sides_of_an_object_share_no_surface():
    poses = orbit(4)
    overlap = covisibility_estimate(poses, np.tile(LENS, (4, 1, 1)), NEAR, 6.0)
    assert overlap[0, 2] < 0.1 and np.array_equal(overlap, overlap.T) and (np.diag(overlap) == 1).all()


FOLDER = Path("scene")


def photographs(*names: str) -> list[PosedPhotograph]:
    return [
        PosedPhotograph(FOLDER / name, name, np.eye(4), lambda width, height: Lens(width, height, 1.0, 1.0, 0.0, 0.0))
        for name in names
    ]


def chosen(available: list[PosedPhotograph], *views: int | str) -> list[str]:
    return [photograph.path.name for photograph in choose_views(available, views, FOLDER)]


def test_by_index_and_by_name():
    available = photographs("left/a.png", "left/b.png", "left/7.png")
    assert chosen(available, 2, 0) == ["7.png", "a.png"]
    assert chosen(available, "b", "a.png", "left/7.png") == ["b.png", "a.png", "7.png"]
    assert chosen(available, "1") == ["b.png"]
    assert chosen(available, "7") == ["7.png"]


@pytest.mark.parametrize(
    ("views", "text"),
    [
        ((3,), "scene: there is no view 3; give indices from 0 to 2 in `views`."),
        (("3",), "scene: there is no view 3; give indices from 0 to 2 in `views`."),
        ((-1,), "scene: there is no view -1; give indices from 0 to 2 in `views`."),
        (
            ("c",),
            "scene: no view is called c (the first is a.png); give indices or names, with commas between them, in "
            "`views`.",
        ),
        (
            ("9" * 5000,),
            f"scene: no view is called {'9' * 80} (the first is a.png); give indices or names, with commas between "
            "them, in `views`.",
        ),
        (("b",), "scene: 2 views are called b; give more of its path, or an index, in `views`."),
        ((0, "a"), "scene: view a.png is chosen twice; name each view once in `views`."),
        ((), "scene: 0 views chosen, but 1 to 16 can be used; change `views`."),
        (tuple(range(17)), "scene: 17 views chosen, but 1 to 16 can be used; change `views`."),
    ],
)
def test_refusals(views, text):
    with pytest.raises(InputError) as caught:
        chosen(photographs("left/a.png", "left/b.png", "right/b.png"), *views)
    assert str(caught.value) == text
