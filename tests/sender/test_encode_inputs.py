"""What `encode` refuses before it does any work."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.views import Views
from fecocodec.sender.encode import encode
from tests.example_scenes import MODEL, example_views


def changed(views: Views, **fields: torch.Tensor) -> Views:
    return replace(views, cameras=replace(views.cameras, **fields))


def with_pose(views: Views, row: int, column: int, value: float) -> Views:
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[1, row, column] = value
    return changed(views, extrinsics=extrinsics)


def with_skew(views: Views) -> Views:
    intrinsics = views.cameras.intrinsics.clone()
    intrinsics[1, 0, 1] = 0.01
    return changed(views, intrinsics=intrinsics)


def unchecked(name: str, value: torch.Tensor) -> Views:
    """Return views with a field that the tests' type checks refuse, which users do not have."""
    views = example_views(2)
    owner: Any = views if name == "images" else views.cameras
    object.__setattr__(owner, name, value)
    return views


@pytest.mark.parametrize(
    ("views", "message"),
    [
        (unchecked("images", torch.rand(2, 4, 64, 64)), r"have the shape \(2, 4, 64, 64\) and the type torch.float32"),
        (unchecked("images", torch.full((2, 3, 64, 64), 255, dtype=torch.uint8)), "torch.uint8; give floats in"),
        (unchecked("extrinsics", torch.eye(3).repeat(2, 1, 1)), r"have shapes \(2, 3, 3\) and \(2, 3, 3\); give 4x4"),
        (with_pose(example_views(2), 0, 3, float("nan")), "camera 2 of 2: tx is nan"),
        (with_pose(example_views(2), 0, 0, 5.0), "camera 2 of 2: its rotation is not orthonormal"),
        (changed(example_views(2), extrinsics=-torch.eye(4).repeat(2, 1, 1)), "mirrored"),
        (changed(example_views(2), near=torch.tensor(20.0)), "far must be 1.002 to 16384 times near"),
        (changed(example_views(2), near=torch.tensor(0.0)), "near is 0.0, it must be"),
        (with_skew(example_views(2)), "camera 2: its intrinsics have a skew"),
        (replace(example_views(2), images=torch.full((2, 3, 64, 64), float("nan"))), "not finite"),
        (replace(example_views(2), images=torch.rand(3, 3, 64, 64)), "3 images of the views were given with 2 cameras"),
        (replace(example_views(2), images=torch.full((2, 3, 64, 64), 255.0)), "values up to 255; divide them"),
        (replace(example_views(2), names=("one",)), "2 images of the views were given with 2 cameras and 1 names"),
        (
            changed(example_views(2), intrinsics=64 * example_views(2).cameras.intrinsics),
            "image sides from",
        ),
        (replace(example_views(2), alpha=torch.zeros(2, 64, 64)), "every pixel of the views is transparent"),
        (replace(example_views(2), alpha=torch.full((2, 64, 64), float("nan"))), "alpha holds values that"),
        (example_views(17), "give 1 to 16"),
        (example_views(2, 63, 64), "sides must be 64 to 1024"),
        (example_views(1, 64, 1025), "sides must be 64 to 1024"),
    ],
)
def test_views_that_cannot_be_coded_are_named(random_weights: Path, views: Views, message: str) -> None:
    with pytest.raises(InputError, match=message):
        encode(views, model=random_weights / MODEL)


def test_guides_of_another_size_are_named(random_weights: Path) -> None:
    with pytest.raises(InputError, match="guides are 96x64 pixels, and views 64x64; read both at one `size`"):
        encode(example_views(2), guides=example_views(2, 64, 96), model=random_weights / MODEL)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        *(({"lmbda": lmbda}, "lambda") for lmbda in (0.0, 9e-6, 1.1e-2, float("nan"))),
        ({"num_stages": 0}, "choose 1 or 2"),
        ({"num_stages": 3}, "choose 1 or 2"),
    ],
)
def test_options_outside_their_range_are_refused(random_weights: Path, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        encode(example_views(1), model=random_weights / MODEL, **options)


def test_a_model_that_is_not_there_is_named(random_weights: Path) -> None:
    with pytest.raises(ModelError, match=r"another.receiver\.safetensors: the weights cannot be read"):
        encode(example_views(1), model=random_weights / "another")
