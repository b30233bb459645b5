"""After matching, views that do not fit the others are named, with shares; views that fit are not."""

from dataclasses import replace

import pytest
import torch

from fecocodec.checkpoint import model_folder
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import load_codec
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.view_overlap import ViewOverlap, overlap_warnings, view_overlap

POSES = torch.stack([look((step, 0.05 * step, -1.5)) for step in (-0.25, 0.0, 0.25)])


def overlap_of(views: Views) -> ViewOverlap:
    """Overlap by the matching of the shipped weights."""
    codec = load_codec(model_folder(None), "cpu")
    scene = prepare_scene(views, codec.device)
    with torch.no_grad():
        matching = SceneEncoder(codec, scene.images, scene.cameras).matching
    return view_overlap(scene.images[0], matching.depth.relative_disparity, scene.cameras.scene(0))


@pytest.fixture(scope="module")
def views() -> Views:
    return replace(photograph(Room(painted), POSES, (128, 128)), names=("a.png", "b.png", "c.png"))


def test_pixels_that_masks_mark_do_not_count(views: Views) -> None:
    scene = prepare_scene(views, torch.device("cpu"))
    is_left = torch.zeros(3, 128, 128, dtype=torch.bool)
    is_left[..., :64] = True
    disparity = torch.full((3, 1, 32, 32), 0.5)
    whole, right, left = (
        view_overlap(scene.images[0], disparity, scene.cameras.scene(0), None, ignored)
        for ignored in (None, is_left, ~is_left)
    )
    for share, of_right, of_left in (
        (whole.shared, right.shared, left.shared),
        (whole.confirmed, right.confirmed, left.confirmed),
    ):
        torch.testing.assert_close((of_right + of_left) / 2, share)
    assert not torch.allclose(right.shared, whole.shared)


def test_views_that_do_not_fit_are_named_with_their_share(views: Views) -> None:
    overlap = overlap_of(views)
    assert overlap.shared.amax(dim=1).min() > 0.5 and overlap.confirmed.amax(dim=1).min() > 0.3
    assert overlap_warnings(overlap, views.names) == ()
    other = photograph(Room(lambda points: waves(points, 9)), POSES.flip(0), (128, 128))
    mixed = replace(views, images=torch.stack((views.images[0], views.images[1], other.images[2].flip(-2))))
    overlap = overlap_of(mixed)
    (warning,) = overlap_warnings(overlap, mixed.names)
    share = 100 * float(torch.maximum(overlap.confirmed, overlap.confirmed.T)[2].max())
    assert warning.startswith(f"the depth of only {share:.1f}% of the pixels of c.png is confirmed by another view; ")
    poses = torch.stack((POSES[0], POSES[1], look((0.25, 0.0, -1.5), 180.0)))
    away = replace(photograph(Room(painted), poses, (128, 128)), names=views.names)
    warnings = overlap_warnings(overlap_of(away), away.names)
    assert warnings[-1].startswith("c.png shares 0.0% of its pixels with the view that overlaps it most; ")
    assert overlap_warnings(ViewOverlap(torch.zeros(1, 1), torch.zeros(1, 1)), ("a.png",)) == ()


def test_parts_that_do_not_confirm_each_other_are_listed() -> None:
    """Two sides of an object: each view is confirmed by its neighbour, but none connects the sides."""
    confirmed = torch.zeros(5, 5)
    for first, second, share in ((0, 1, 0.5), (2, 3, 0.2), (1, 2, 0.03), (0, 4, 0.01)):
        confirmed[first, second] = share
    names = ("a.png", "b.png", "c.png", "d.png", "e.png")
    warnings = overlap_warnings(ViewOverlap(torch.full((5, 5), 0.5), confirmed), names)
    assert [warning.split(";")[0] for warning in warnings] == [
        "the depth of only 1.0% of the pixels of e.png is confirmed by another view",
        "the views fall into 2 parts that hardly confirm each other: a.png, b.png",
    ]
    assert warnings[1].endswith(
        "; c.png, d.png; check their cameras, choose `views` that connect the parts, or encode each part to a file of "
        "its own."
    )
    confirmed[1, 2] = 0.05
    assert len(overlap_warnings(ViewOverlap(torch.full((5, 5), 0.5), confirmed), names)) == 1
