"""Doubts: said of views that promise little, and not of others."""

from dataclasses import replace

import pytest
import torch

from fecocodec.evaluation.stress.box_room import Room, painted, photograph
from fecocodec.evaluation.stress.camera_paths import back_to_back, look, sideways, turning
from fecocodec.geometry.views import Views
from fecocodec.sender import doubts
from fecocodec.sender.doubts import doubts_about


def context_of(poses: torch.Tensor) -> Views:
    return photograph(Room(painted), poses, (64, 64)).select([0, 1])


def test_good_views_are_not_doubted() -> None:
    assert doubts_about(context_of(sideways())) == ()


def test_refinement_that_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    views = context_of(sideways())
    monkeypatch.setattr(doubts, "MOST_PIXELS", 2 * 64 * 64 - 1)
    (doubt,) = doubts_about(views, 3)
    assert doubt.startswith("the views have too many pixels for steps of refinement")
    assert doubts_about(views, None) == doubts_about(views, 0) == ()
    monkeypatch.setattr(doubts, "MOST_PIXELS", 2 * 64 * 64)
    assert doubts_about(views, 3) == ()


@pytest.mark.parametrize(
    ("poses", "sentence"),
    [
        (sideways(0.002), "the views stand almost at one place"),
        (turning(), "the views stand almost at one place"),
        (back_to_back(), "views that see little of what any other sees: 0, 1"),
    ],
)
def test_cameras_that_promise_little(poses: torch.Tensor, sentence: str) -> None:
    assert any(doubt.startswith(sentence) for doubt in doubts_about(context_of(poses)))


def test_cameras_in_the_axes_of_another_convention() -> None:
    converging = torch.stack([look((-0.4, 0.0, -1.5), 12.0), look((0.4, 0.05, -1.5), -12.0)])
    views = photograph(Room(painted), converging, (64, 64))
    assert doubts_about(views) == ()
    reversed_axes = views.cameras.extrinsics @ torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
    turned = replace(views, cameras=replace(views.cameras, extrinsics=reversed_axes))
    assert any("y and z axes reversed" in doubt for doubt in doubts_about(turned))


def test_photographs_and_bounds_that_promise_little() -> None:
    views = context_of(sideways())
    wide = replace(views, cameras=replace(views.cameras, far=views.cameras.near * 5000))
    assert any("far is 5000 times near" in doubt for doubt in doubts_about(wide))
    dark = replace(views, images=views.images * 0.01)
    assert any("almost black or white" in doubt for doubt in doubts_about(dark))
    uneven = replace(views, images=views.images * torch.tensor([0.4, 1.0])[:, None, None, None])
    assert any("differ much in brightness" in doubt for doubt in doubts_about(uneven))
    (doubt,) = doubts_about(views.select([0]))
    assert doubt.startswith("one view has no parallax")
