"""Rate control: targets of size and quality are kept, unreachable ones are refused."""

from pathlib import Path

import pytest
import torch

from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender import rate_control
from fecocodec.sender.distortion import mean_psnr
from fecocodec.sender.encode import encode_with, load_profile
from fecocodec.sender.rate_control import AtLeastPsnr, AtMostKib, encode_to_target_with
from fecocodec.sender.steps import Profile
from tests.example_scenes import MODEL, example_views


@pytest.fixture(scope="module")
def profile(random_weights: Path) -> Profile:
    return load_profile(random_weights / MODEL, "cpu")


@pytest.fixture(scope="module")
def views() -> Views:
    return example_views(3)


def context_psnr(profile: Profile, data: bytes, views: Views) -> float:
    with torch.no_grad():
        gaussians = decode_with(profile.receiver, data).gaussians
        return mean_psnr(render(gaussians, views.cameras, views.image_size).color, views.images)


def test_a_size_is_not_exceeded(profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rate_control, "MOST_ENCODINGS", 4)
    smallest = encode_with(profile, views, quantise_lambda(1e-2), 2, refinement_steps=2)
    target = 1.5 * len(smallest) / 1024
    found = encode_to_target_with(profile, views, AtMostKib(target), refinement_steps=2)
    assert len(found) <= 1024 * target
    assert quality_of(profile, found, views) >= quality_of(profile, smallest, views) - 0.05


def test_a_quality_is_reached_or_refused(profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rate_control, "MOST_ENCODINGS", 4)
    best = encode_with(profile, views, quantise_lambda(1e-5), 2, refinement_steps=2)
    goal = AtLeastPsnr(quality_of(profile, best, views) - 1.0)
    found = encode_to_target_with(profile, views, goal, refinement_steps=2)
    assert quality_of(profile, found, views) > goal.psnr - 0.05
    with pytest.raises(InputError, match="a PSNR of 99 dB cannot be reached, the best of these views is"):
        encode_to_target_with(profile, views, AtLeastPsnr(99.0), refinement_steps=2)


def quality_of(profile: Profile, data: bytes, views: Views) -> float:
    return context_psnr(profile, data, views)
