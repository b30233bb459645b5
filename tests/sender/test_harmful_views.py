"""Views that make the reconstruction of the others worse are left out and named; views that fit all stay."""

from dataclasses import replace

import pytest
import torch

from fecocodec import without_harmful_views
from fecocodec.errors import InputError
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.views import Views
from fecocodec.sender.harmful_views import left_out_note

POSES = torch.stack([look((step, 0.05 * step, -1.5)) for step in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)])
NAMES = tuple(f"{letter}.png" for letter in "abcdef")


@pytest.fixture(scope="module")
def fitting() -> Views:
    return replace(photograph(Room(painted), POSES, (96, 128)), names=NAMES)


@pytest.fixture(scope="module")
def mixed(fitting: Views) -> Views:
    """The fourth photograph is one of another room."""
    other = photograph(Room(lambda points: waves(points, 9)), POSES, (96, 128))
    images = fitting.images.clone()
    images[3] = other.images[3].flip(-2)
    return replace(fitting, images=images)


def test_views_that_fit_stay(fitting: Views) -> None:
    left_out: list[str] = []
    kept = without_harmful_views(fitting, on_left_out=left_out.extend)
    assert (kept.names, left_out) == (NAMES, [])
    assert torch.equal(kept.images, fitting.images)


def test_the_view_that_hides_the_others_is_left_out_and_named(mixed: Views) -> None:
    left_out: list[str] = []
    kept = without_harmful_views(mixed, on_left_out=left_out.extend)
    assert "d.png" in left_out
    assert kept.names == tuple(name for name in NAMES if name not in left_out)
    assert kept.cameras.num_views == len(kept.images) == len(kept.names) >= 4
    assert torch.equal(kept.images[0], mixed.images[0])


def test_large_views_are_judged_as_small_ones_and_kept_large(mixed: Views) -> None:
    large = torch.nn.functional.interpolate(mixed.images, (192, 256), mode="bicubic").clamp(0, 1)
    kept = without_harmful_views(replace(mixed, images=large))
    assert "d.png" not in kept.names
    assert kept.image_size == (192, 256)


def test_transparent_views_are_judged_on_white(mixed: Views) -> None:
    alpha = torch.ones(6, 96, 128)
    alpha[:, :32] = 0.0
    images = torch.where(alpha[:, None] > 0, mixed.images, torch.ones(()))
    kept = without_harmful_views(replace(mixed, images=images, alpha=alpha))
    assert "d.png" not in kept.names
    assert kept.alpha is not None and len(kept.alpha) == len(kept.names)


def test_views_without_content_stay(fitting: Views) -> None:
    white = replace(fitting, images=torch.ones_like(fitting.images))
    assert without_harmful_views(white).names == NAMES
    alpha = torch.zeros(6, 96, 128)
    alpha[0] = 1.0  # no other view has Gaussians
    assert NAMES[0] in without_harmful_views(replace(fitting, alpha=alpha)).names


def test_fewer_than_five_views_are_not_judged(mixed: Views) -> None:
    four = mixed.select([0, 1, 3, 4])
    assert without_harmful_views(four).names == four.names


def test_views_that_cannot_be_encoded_are_refused(fitting: Views) -> None:
    with pytest.raises(InputError, match="a view holds values that are not finite"):
        without_harmful_views(replace(fitting, images=fitting.images * float("nan")))


def test_the_note_names_the_views_and_how_to_keep_them() -> None:
    assert left_out_note(["a.png", "c.png"]) == (
        "left out a.png, c.png: the other views are better without them; to keep all, use `views=all`."
    )
