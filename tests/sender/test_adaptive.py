"""The adaptive sender: what does not pay is not sent, what nobody would miss is not emitted, goals are reached."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.container import Stream, quantise_lambda, read_stream
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_stream
from fecocodec.rendering.rasterizer import render
from fecocodec.sender import adaptive, refinement, second_stage, unneeded
from fecocodec.sender.adaptive import AtLambda, AtLeastPsnr, AtMostKib, encode_adaptively_with
from fecocodec.sender.distortion import mean_psnr
from fecocodec.sender.encode import encode_with, load_profile
from fecocodec.sender.steps import Profile
from tests.example_scenes import MODEL, example_views

LAMBDA = 1e-4


@pytest.fixture(scope="module")
def profile(random_weights: Path) -> Profile:
    return load_profile(random_weights / MODEL, "cpu")


@pytest.fixture(autouse=True)
def fewer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refinement, "MANY_STEPS", 7)  # sixteen take long


@pytest.fixture(scope="module")
def views() -> Views:
    return example_views(3)


def context_psnr(profile: Profile, stream: Stream, views: Views) -> float:
    with torch.no_grad():
        gaussians = decode_stream(stream, profile.receiver)
        return mean_psnr(render(gaussians, views.cameras, views.image_size).color, views.images)


def plainly_encoded(profile: Profile, views: Views, num_stages: int) -> Stream:
    """Without decisions, in as many steps of refinement as the adaptive sender takes."""
    return read_stream(
        encode_with(profile, views, quantise_lambda(LAMBDA), num_stages, refinement_steps=refinement.MANY_STEPS)
    )


@pytest.mark.parametrize(("gain", "num_stages"), [(0.9, 1), (1.1, 2)])
def test_stage_2_is_sent_where_it_gains_more_than_its_bits_cost(
    profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch, gain: float, num_stages: int
) -> None:
    """The gain is said to be so many times the price of the bits that two stages take more."""
    alone, both = (read_stream(encode_with(profile, views, quantise_lambda(LAMBDA), stages)) for stages in (1, 2))
    more = sum(map(len, both.payloads)) - len(alone.payloads[0])
    price = LAMBDA * 8 * more / views.images[:, 0].numel()
    assert price > 0
    errors = iter([gain * price, 0.0])  # of one stage, of two
    monkeypatch.setattr(second_stage, "squared_error", lambda _renderings, _images: next(errors))
    stream = read_stream(encode_adaptively_with(profile, views, AtLambda(LAMBDA)))
    assert stream.header.num_stages == num_stages
    assert decode_stream(stream, profile.receiver).count > 0


def test_a_stage_that_gains_nothing_is_dropped(profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_stage, "squared_error", lambda _renderings, _images: 0.0)
    chosen = read_stream(encode_adaptively_with(profile, views, AtLambda(LAMBDA)))
    alone = plainly_encoded(profile, views, num_stages=1)
    assert chosen.payloads == alone.payloads and chosen.header.num_stages == 1


def test_what_is_left_out_is_hardly_missed(profile: Profile, views: Views) -> None:
    stream = read_stream(encode_adaptively_with(profile, views, AtLambda(1e-5)))  # large enough to say what is left out
    assert stream.keep is not None
    everything = replace(stream, keep=None)
    assert decode_stream(stream, profile.receiver).count < decode_stream(everything, profile.receiver).count
    loss = context_psnr(profile, everything, views) - context_psnr(profile, stream, views)
    assert abs(loss) < 0.05


def test_nothing_is_left_out_where_no_loss_is_allowed(
    profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unneeded, "LARGEST_LOSS", -1.0)
    stream = read_stream(encode_adaptively_with(profile, views, AtLambda(LAMBDA)))
    assert stream.keep is None


def test_a_size_is_not_exceeded(profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive, "MOST_ENCODINGS", 4)
    smallest = encode_adaptively_with(profile, views, AtLambda(1e-2), refinement_steps=2)
    target = 1.5 * len(smallest) / 1024
    found = encode_adaptively_with(profile, views, AtMostKib(target), refinement_steps=2)
    assert len(found) <= 1024 * target
    assert quality_of(profile, found, views) >= quality_of(profile, smallest, views) - 0.05


def test_a_quality_is_reached_or_refused(profile: Profile, views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive, "MOST_ENCODINGS", 4)
    best = encode_adaptively_with(profile, views, AtLambda(1e-5), refinement_steps=2)
    goal = AtLeastPsnr(quality_of(profile, best, views) - 1.0)
    found = encode_adaptively_with(profile, views, goal, refinement_steps=2)
    assert quality_of(profile, found, views) > goal.psnr - 0.05
    with pytest.raises(InputError, match="a PSNR of 99 dB cannot be reached, the best of these views is"):
        encode_adaptively_with(profile, views, AtLeastPsnr(99.0), refinement_steps=2)


def quality_of(profile: Profile, data: bytes, views: Views) -> float:
    return context_psnr(profile, read_stream(data), views)
