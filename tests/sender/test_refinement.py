"""Refinement lowers what encoding minimises, gives the same bytes every time, and is left out where it does not fit."""

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from fecocodec.container.lagrangian import dequantise_lambda, quantise_lambda
from fecocodec.sender import refinement
from fecocodec.sender.distortion import distortions
from fecocodec.sender.encode import code_stages, encode, encode_with, load_profile
from fecocodec.sender.refinement import refined_first_latents
from fecocodec.sender.steps import (
    PreparedScene,
    Profile,
    code_stage,
    first_stage_lambda_q,
    match_views,
    prepare,
    stage_rendering,
)
from tests.example_scenes import MODEL, example_views

LAMBDA_Q = quantise_lambda(1e-4)
COARSE_LAMBDA_Q = quantise_lambda(1e-3)


@pytest.fixture(scope="module")
def profile(random_weights: Path) -> Profile:
    return load_profile(random_weights / MODEL, "cpu")


@pytest.fixture(scope="module")
def scene(profile: Profile) -> PreparedScene:
    with torch.no_grad():
        return prepare(profile, example_views(2))


@torch.no_grad()
def objective(profile: Profile, scene: PreparedScene, refinement_steps: int) -> float:
    """D + lambda R of the stream itself."""
    matched = match_views(profile, scene)
    stages = code_stages(profile, scene, matched, LAMBDA_Q, 2, refinement_steps=refinement_steps)
    rendering = stage_rendering(profile, scene, stages[1].after).color
    bits_per_pixel = 8 * len(stages[1].payload) / (scene.num_views * 64 * 64)
    return float(distortions(rendering, scene.images).mean()) + dequantise_lambda(LAMBDA_Q) * bits_per_pixel


def test_more_steps_lower_the_objective(profile: Profile, scene: PreparedScene) -> None:
    unrefined, few, many = (objective(profile, scene, steps) for steps in (0, 3, 12))
    assert many < few < unrefined


def test_scenes_get_as_many_steps_as_their_size_allows(scene: PreparedScene, monkeypatch: pytest.MonkeyPatch) -> None:
    def steps_of(every: int, most: int, lambda_q: int = COARSE_LAMBDA_Q) -> int:
        monkeypatch.setattr(refinement, "PIXELS_OF_ALL_STEPS", every)
        monkeypatch.setattr(refinement, "MOST_PIXELS", most)
        return refinement.suitable_steps(scene, lambda_q)

    pixels = 2 * 64 * 64
    assert steps_of(pixels, pixels) == refinement.DEFAULT_STEPS
    assert steps_of(pixels - 1, pixels) == 1
    assert steps_of(pixels - 1, pixels - 1) == 0
    finest = [steps_of(*sizes, lambda_q=0) for sizes in ((pixels, pixels), (0, pixels), (0, 0))]
    assert finest == [refinement.DEFAULT_STEPS + 2, 3, 0]
    assert steps_of(pixels, pixels, LAMBDA_Q) == refinement.DEFAULT_STEPS + 1


def test_encoding_refines_unless_told_not_to_and_always_alike(profile: Profile) -> None:
    views = example_views(2)
    steps = (None, None, refinement.DEFAULT_STEPS, 0)
    streams = [encode_with(profile, views, COARSE_LAMBDA_Q, 2, refinement_steps=number) for number in steps]
    by_default, again, as_many, none = streams
    assert by_default == again == as_many != none


def test_every_stage_is_refined_by_its_own_rate_and_distortion(profile: Profile) -> None:
    """The first stage of two gets half of the steps and one, at its own lambda; a stage that is alone gets all."""
    views, lambda_q = example_views(2), LAMBDA_Q
    with torch.no_grad():
        scene = prepare(profile, views)
        matched = match_views(profile, scene)
        both = code_stages(profile, scene, matched, lambda_q, 2, refinement_steps=4)
        (alone,) = code_stages(profile, scene, matched, lambda_q, 1, refinement_steps=4)
        first_lambda_q = first_stage_lambda_q(lambda_q)
        first = refined_first_latents(profile, scene, matched, first_lambda_q, 3)
        every = refined_first_latents(profile, scene, matched, lambda_q, 4)
        expected = [
            code_stage(profile, scene, latents, q, None).payload
            for latents, q in ((first, first_lambda_q), (every, lambda_q))
        ]
    assert [both[0].payload, alone.payload] == expected


def test_many_steps_hold_the_views_between_and_few_do_not(
    profile: Profile, scene: PreparedScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """How far the view half-way moves from where it was before the first step."""
    first_lambda_q = first_stage_lambda_q(LAMBDA_Q)

    @torch.no_grad()
    def between(num_steps: int) -> Tensor:
        matched = match_views(profile, scene)
        latents = refined_first_latents(profile, scene, matched, first_lambda_q, num_steps)
        first = code_stage(profile, scene, latents, first_lambda_q, None)
        held = refinement.hold_views_between(profile, scene, first.after)
        assert held is not None
        return held.images

    start, few = between(0), between(3)
    held = (between(12) - start).square().mean()
    monkeypatch.setattr(refinement, "HELD_WEIGHT", 0.0)
    free = (between(12) - start).square().mean()
    assert torch.equal(between(3), few)
    assert 0.0 < held < free


@pytest.mark.parametrize(("most", "passes_by"), [(2, True), (1, False)])
def test_gradients_pass_side_branches_by_where_views_are_few(
    profile: Profile, scene: PreparedScene, most: int, passes_by: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    attend = type(profile.receiver.predictor)._attend

    def watched(*inputs: Any) -> Tensor:
        asked.append(torch.is_grad_enabled())
        return attend(*inputs)

    monkeypatch.setattr(refinement, "MOST_VIEWS_OF_DIRECT_GRADIENTS", most)
    monkeypatch.setattr(type(profile.receiver.predictor), "_attend", watched)
    with torch.no_grad():
        matched = match_views(profile, scene)
        refined_first_latents(profile, scene, matched, COARSE_LAMBDA_Q, 2)
    assert asked == 2 * [not passes_by]


def test_views_without_neighbours_are_refined_without_holding_any(profile: Profile) -> None:
    alone = example_views(2).select([0])
    many, none = (encode_with(profile, alone, LAMBDA_Q, 2, refinement_steps=steps) for steps in (12, 0))
    assert many != none


def test_callers_may_be_in_inference_mode(random_weights: Path) -> None:
    plain = encode(example_views(2), model=random_weights / MODEL)
    load_profile.cache_clear()
    with torch.inference_mode():
        views = example_views(2)
        assert encode(views, model=random_weights / MODEL) == plain


def test_a_step_that_raises_the_objective_is_taken_back() -> None:
    """A steep valley, narrower than the first step: only halved steps get closer to its bottom."""
    start = torch.full((1, 1, 2, 2), 0.01)
    end = refinement.descend(start, lambda y: y.abs().sum(), 12, 0.12)
    assert float(end.abs().max()) < 0.01


def test_descent_stays_where_there_is_no_gradient() -> None:
    start = torch.ones(1, 1, 2, 2)
    for objective in (lambda y: 0.0 * y.sum(), lambda y: torch.nan * y.sum()):
        assert torch.equal(refinement.descend(start, objective, 3, 0.12), start)


def test_without_steps_the_bytes_are_those_of_the_networks(profile: Profile, monkeypatch: pytest.MonkeyPatch) -> None:
    views = example_views(2)
    refined, plain = (encode_with(profile, views, LAMBDA_Q, 2, refinement_steps=steps) for steps in (3, 0))
    monkeypatch.setattr(refinement, "MOST_PIXELS", 2 * 64 * 64 - 1)
    too_large = encode_with(profile, views, LAMBDA_Q, 2, refinement_steps=3)
    assert too_large == plain != refined


def test_refining_leaves_no_gradients_in_the_networks(profile: Profile) -> None:
    encode_with(profile, example_views(2), LAMBDA_Q, 2, refinement_steps=1)
    networks = (profile.sender, profile.receiver)
    assert all(parameter.grad is None for network in networks for parameter in network.parameters())
