"""Views that will reconstruct badly get a warning, others do not."""

from dataclasses import replace

import pytest
import torch

from fecocodec.evaluation.stress.box_room import Room, back_to_back, look, painted, photograph, sideways, turning
from fecocodec.geometry.views import Views
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.optimisation_config import DEFAULT
from tests.turned_cameras import with_turned_camera

pytestmark = pytest.mark.usefixtures("found_once")


def context_of(poses: torch.Tensor) -> Views:
    return photograph(Room(painted), poses, (64, 64)).select([0, 1])


def test_good_views_get_no_warning_and_others_do() -> None:
    assert check_input(context_of(sideways())) == ()
    views, pixels = context_of(sideways()), 2 * 64 * 64
    (warning,) = check_input(views, replace(DEFAULT, max_pixels=pixels - 1))
    assert warning.startswith("the views have 8,192 pixels in all, more than the 8,191 up to which latents are")
    assert check_input(views, replace(DEFAULT, max_pixels=pixels)) == check_input(views, "fast") == ()
    (warning,) = check_input(replace(views, images=views.images.repeat_interleave(2, dim=2)))
    assert warning.startswith(
        "the pixels are 2.0 times as long as wide or the reverse, by the focal lengths, so detail"
    )
    assert warning.endswith("correct `fl_x` and `fl_y`, or choose a `size` of the photographs' own shape.")


@pytest.mark.parametrize(
    ("poses", "sentence"),
    [
        (sideways(0.002), "the cameras are almost at one position"),
        (turning(), "the cameras are almost at one position"),
        (back_to_back(), "by their cameras, these views hardly overlap with any other: view 0 (0%), view 1 (0%)"),
    ],
)
def test_cameras_that_reconstruct_badly(poses: torch.Tensor, sentence: str) -> None:
    assert any(warning.startswith(sentence) for warning in check_input(context_of(poses)))


def test_what_masks_mark_needs_no_overlap() -> None:
    poses = torch.stack([look((-0.1, 0.0, -1.5), -24.0), look((0.1, 0.05, -1.5), 24.0)])
    views = photograph(Room(painted), poses, (64, 64))
    assert "hardly overlap with any other: view 0 (12%), view 1 (12%)" in "".join(check_input(views))
    ignored = torch.zeros(2, 64, 64, dtype=torch.bool)
    ignored[0, :, :48] = ignored[1, :, 16:] = True
    assert "overlap" not in "".join(check_input(replace(views, ignored=ignored)))


def test_cameras_in_the_axes_of_another_convention() -> None:
    converging = torch.stack([look((-0.4, 0.0, -1.5), 12.0), look((0.4, 0.05, -1.5), -12.0)])
    views = photograph(Room(painted), converging, (64, 64))
    assert check_input(views) == ()
    reversed_axes = views.cameras.extrinsics @ torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
    turned = replace(views, cameras=replace(views.cameras, extrinsics=reversed_axes))
    assert any("y and z axes reversed" in warning for warning in check_input(turned))


def test_bounds_that_miss_the_scene_or_are_far_too_wide() -> None:
    views = context_of(sideways())

    def warnings(near: float, far: float) -> tuple[str, ...]:
        return check_input(views.within(near, far))

    assert warnings(0.5, 10.0) == warnings(2.0, 3.0) == ()
    for near, far in ((20.0, 200.0), (0.01, 0.1), (0.05, 49.0)):
        warning = warnings(near, far)[-1]
        assert warning.startswith(f"near and far are {near:.3g} and {far:.3g}, but matching finds the scene between ")
        assert warning.endswith("give `near` and `far` in the unit of the camera positions, or leave both out.")


def test_a_camera_that_is_turned_is_named() -> None:
    (warning,) = check_input(with_turned_camera(context_of(sideways()), 1, 6.0))
    assert warning.startswith(
        "view 0 and view 1 fit each other much better with a camera turned by about 6 degrees, so"
    )
    poses = torch.stack([look((0.3 * number - 0.45, 0.05 * number, -1.5), 0.0) for number in range(4)])
    views = photograph(Room(painted), poses, (64, 64))
    assert check_input(views) == ()
    wrong = with_turned_camera(views, 2, 6.0)
    (warning,) = check_input(wrong)
    assert warning.startswith(f"{wrong.names[2]} fits the photographs beside it much better with a camera turned by")
    # Of two coded views, guides tell which one is wrong; a wrong guide is not a matter of this check.
    (warning,) = check_input(wrong.select([0, 2]), guides=wrong.select([1, 3]))
    assert warning.startswith(f"{wrong.names[2]} fits the photographs beside it")
    assert check_input(wrong.select([0, 3]), guides=wrong.select([2])) == ()


def test_views_of_other_kinds_than_the_rest() -> None:
    views = context_of(sideways())
    grey = views.images.mean(dim=1, keepdim=True).expand(-1, 3, -1, -1)
    one_grey = replace(views, images=torch.stack((views.images[0], grey[1])))
    (warning,) = check_input(one_grey)
    assert warning.startswith("view 1 is without colours, the other views are coloured; give all")
    assert check_input(replace(views, images=grey)) == ()
    opaque = torch.ones(2, 64, 64)
    in_part = opaque.clone()
    in_part[0, :8] = 0.0
    (warning,) = check_input(replace(views, alpha=in_part))
    assert warning.startswith("view 0 is transparent in part, the other views are opaque; cut out the object in all")
    in_part[1, :8] = 0.5
    assert check_input(replace(views, alpha=in_part)) == check_input(replace(views, alpha=opaque)) == ()


def test_photographs_and_bounds_that_reconstruct_badly() -> None:
    views = context_of(sideways())
    wide = replace(views, cameras=replace(views.cameras, far=views.cameras.near * 5000))
    assert any("far is 5000 times near" in warning for warning in check_input(wide))
    dark = replace(views, images=views.images * 0.01)
    assert any("almost black or white" in warning for warning in check_input(dark))
    one_shows_a_dark_room = replace(views, images=views.images * torch.tensor([0.4, 1.0])[:, None, None, None])
    assert check_input(one_shows_a_dark_room) == check_input(views)
    (warning,) = check_input(views.select([0]))
    assert warning.startswith("one view has no parallax")
