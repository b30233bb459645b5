"""Optimised latents lower D + lambda R, give the same bytes every time, and are left out where they do not fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from fecocodec.container.lambda_quantisation import dequantise_lambda, quantise_lambda
from fecocodec.errors import InputError
from fecocodec.sender import latent_optimisation
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.distortion import LogDistortion, MseDistortion
from fecocodec.sender.encode import encode, encode_with, write_stages
from fecocodec.sender.latent_optimisation import (
    LONGEST_LOCAL_STEP,
    Objective,
    Slope,
    descend,
    hold_views_between,
    proposer,
)
from fecocodec.sender.optimisation_config import BEST, DEFAULT, FAST, OptimisationConfig, config_of_effort
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Stage, WrittenLatent
from tests.example_scenes import MODEL, example_views

LAMBDA_Q = quantise_lambda(1e-4)
COARSE_LAMBDA_Q = quantise_lambda(1e-3)
PIXELS = 2 * 64 * 64


# Renderings of random networks are so far off that the gradient of their logarithm is tiny.
MSE = replace(DEFAULT, distortion=MseDistortion())


@pytest.fixture(scope="module")
def encoder(codec: Codec) -> SceneEncoder:
    with torch.no_grad():
        scene = prepare_scene(example_views(2), codec.device)
        return SceneEncoder(codec, scene.images, scene.cameras)


@torch.no_grad()
def coded(
    encoder: SceneEncoder, config: OptimisationConfig, lambda_q: int = LAMBDA_Q, num_stages: int = 2
) -> tuple[Stage[WrittenLatent], ...]:
    return write_stages(encoder, lambda_q, num_stages, config)


@torch.no_grad()
def objective(encoder: SceneEncoder, config: OptimisationConfig) -> float:
    """D + lambda R of the stream itself."""
    last = coded(encoder, config)[1]
    rendering = encoder.render(last).scenes[0].color
    bits_per_pixel = 8 * len(last.coded.payload) / PIXELS
    distortion = config.distortion(rendering, encoder.images[0])
    return float(distortion.mean()) + dequantise_lambda(LAMBDA_Q) * bits_per_pixel


def test_more_steps_lower_the_objective_that_is_asked_for(encoder: SceneEncoder) -> None:
    none, few, many = (objective(encoder, MSE.with_steps(steps)) for steps in (0, 2, 9))
    assert many < few < none
    none, few = (objective(encoder, replace(DEFAULT.with_steps(s), distortion=LogDistortion())) for s in (0, 2))
    assert few < none


def test_encoding_optimises_by_default_and_leaves_no_gradients_in_the_networks(codec: Codec) -> None:
    views = example_views(2)
    by_default = encode_with(codec, views, COARSE_LAMBDA_Q)
    as_many, none = (encode_with(codec, views, COARSE_LAMBDA_Q, config=DEFAULT.with_steps(steps)) for steps in (4, 0))
    assert by_default == as_many != none
    networks = (codec.sender, codec.receiver)
    assert all(parameter.grad is None for network in networks for parameter in network.parameters())


def test_efforts_have_names_and_as_many_steps_as_the_size_allows() -> None:
    assert config_of_effort("best") == BEST and config_of_effort(FAST) is FAST
    with pytest.raises(InputError, match="no effort 'most'; choose one of fast, default, best"):
        config_of_effort("most")
    small, large, largest = DEFAULT.large_pixels, DEFAULT.max_pixels, DEFAULT.max_pixels + 1
    sizes = (small, large, largest)
    assert [DEFAULT.steps_of_last(size, quantise_lambda(1e-2)) for size in sizes] == [6, 2, 0]
    assert [DEFAULT.steps_of_last(size, COARSE_LAMBDA_Q) for size in sizes] == [4, 2, 0]
    assert [DEFAULT.steps_of_last(size, LAMBDA_Q) for size in sizes] == [5, 3, 0]
    assert [DEFAULT.steps_of_last(size, 0) for size in sizes] == [8, 6, 0]
    assert [BEST.steps_of_last(size, 0) for size in sizes] == [16, 6, 0]
    assert [BEST.steps_of_last(size, quantise_lambda(1e-2)) for size in sizes] == [16, 6, 0]
    assert [FAST.steps_of_last(size, 0) for size in sizes] == [0, 0, 0]
    assert [DEFAULT.with_steps(9).steps_of_last(size, 0) for size in sizes] == [9, 9, 0]
    assert DEFAULT.steps_of_stages(small, COARSE_LAMBDA_Q, is_taught=False) == (3, 4)
    assert DEFAULT.steps_of_stages(small, COARSE_LAMBDA_Q, is_taught=True) == (1, 5)
    assert FAST.steps_of_stages(small, COARSE_LAMBDA_Q, is_taught=True) == (0, 0)


def test_many_steps_hold_the_views_between_and_few_do_not(
    encoder: SceneEncoder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """How far the view half-way moves from where it was before the first step."""

    @torch.no_grad()
    def between(config: OptimisationConfig) -> Tensor:
        (stage,) = coded(encoder, config, num_stages=1)
        prediction = encoder.predict(stage.state, stage.inputs.condition)
        held = hold_views_between(encoder, encoder.emit(prediction, has_fitted_colours=False, is_filled=False))
        assert held is not None
        return held[1]

    monkeypatch.setattr(latent_optimisation, "STEP_SIZE", 1.0)  # shorter steps change no symbol of these networks
    start = between(FAST)
    held, few = ((between(MSE.with_steps(steps)) - start).square().mean() for steps in (9, 3))
    monkeypatch.setattr(latent_optimisation, "HELD_WEIGHT", 0.0)
    free, few_freely = ((between(MSE.with_steps(steps)) - start).square().mean() for steps in (9, 3))
    assert 0.0 < held < free
    assert few == few_freely


@pytest.mark.parametrize(("most", "is_skipped"), [(2, True), (1, False)])
def test_gradients_skip_residual_branches_where_views_are_few(
    encoder: SceneEncoder, most: int, is_skipped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    has_gradient = []
    predictor = type(encoder.codec.receiver.predictor)
    attend = predictor._attend

    def watched(*inputs: Any) -> Tensor:
        has_gradient.append(torch.is_grad_enabled())
        return attend(*inputs)

    monkeypatch.setattr(predictor, "_attend", watched)
    monkeypatch.setattr(latent_optimisation, "MAX_VIEWS_OF_DIRECT_GRADIENTS", most)
    coded(encoder, DEFAULT.with_steps(2), COARSE_LAMBDA_Q, num_stages=1)
    assert has_gradient == 2 * [not is_skipped]


@pytest.mark.parametrize(("num_views", "longest"), [(3, 50.0), (4, LONGEST_LOCAL_STEP)])
@torch.no_grad()
def test_no_position_goes_far_in_one_step_where_views_are_many(codec: Codec, num_views: int, longest: float) -> None:
    scene = prepare_scene(example_views(num_views), codec.device)
    encoder = SceneEncoder(codec, scene.images, scene.cameras)
    inputs = encoder.inputs_of([], torch.tensor([LAMBDA_Q]), is_last=False)
    features = encoder.features(inputs.condition)
    y = encoder.analyse(features, inputs)
    gradient = torch.ones_like(y)
    gradient[:, :, 1, 1] = 50.0
    propose, zero = proposer(encoder, features, inputs), torch.zeros_like(y)
    step = propose(Slope(gradient, zero, torch.zeros_like(scene.images[0])), y, zero, 1.0)
    rms = step.square().mean(dim=1).sqrt()
    assert torch.allclose(rms[:, 1, 1], torch.tensor(longest), rtol=0.1)
    assert torch.allclose(rms[:, 3:, 3:], torch.tensor(1.0), rtol=0.1)


def test_views_without_neighbours_are_optimised_and_large_scenes_are_not(codec: Codec) -> None:
    alone = example_views(2).select([0])
    many, none = (encode_with(codec, alone, LAMBDA_Q, config=DEFAULT.with_steps(steps)) for steps in (4, 0))
    assert many != none
    small = replace(DEFAULT.with_steps(3), max_pixels=PIXELS - 1)
    large, none = (encode_with(codec, example_views(2), LAMBDA_Q, config=config) for config in (small, FAST))
    assert large == none


def test_callers_may_be_in_inference_mode(random_weights: Path) -> None:
    options = {"model": random_weights / MODEL, "effort": DEFAULT.with_steps(1), "num_stages": 1}
    plain = encode(example_views(2), **options)
    load_codec.cache_clear()
    with torch.inference_mode():
        views = example_views(2)
        assert encode(views, **options) == plain


def distortion_alone(distortion: Tensor, y: Tensor) -> Objective:
    return Objective(distortion, 0.0 * y.sum(), torch.zeros(1, 3, 16, 16))


def test_descent_takes_back_what_raises_the_objective_and_stays_without_a_gradient() -> None:
    # A steep valley, narrower than the first step: only halved steps get closer to its bottom.
    start = torch.full((1, 1, 2, 2), 0.01)
    end = descend(start, lambda y: distortion_alone(y.abs().sum(), y), 12, 0.12)
    assert float(end.abs().max()) < 0.01
    start = torch.ones(1, 1, 2, 2)
    for factor in (0.0, torch.nan):
        found = descend(start, lambda y, factor=factor: distortion_alone(factor * y.sum(), y), 3, 0.12)
        assert torch.equal(found, start)


def test_distortions_are_as_documented() -> None:
    images = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    noisy = (images + 0.1).clamp(0, 1)
    squared = (noisy - images).square().mean(dim=(1, 2, 3))
    mse, log = MseDistortion(), LogDistortion()
    same = torch.zeros(2)
    torch.testing.assert_close(mse(images, images), same, atol=1e-6, rtol=0)
    torch.testing.assert_close(log(images, images), same + 0.01 * torch.log(torch.tensor(2e-4)), atol=1e-6, rtol=0)
    structure = (mse(noisy, images) - squared) / 0.03
    torch.testing.assert_close(log(noisy, images), 0.01 * torch.log(squared + 2e-4) + 0.01 * structure)
