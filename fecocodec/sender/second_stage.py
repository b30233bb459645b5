"""Whether the second stage is worth its bytes."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fecocodec.container.lagrangian import dequantise_lambda
from fecocodec.sender.distortion import distortions
from fecocodec.sender.refinement import refine_second_stage
from fecocodec.sender.steps import (
    CodedStage,
    MatchedViews,
    PreparedScene,
    Profile,
    analyse,
    code_stage,
    feedback_features,
    stage_rendering,
    start_state,
)


@dataclass(frozen=True)
class ChosenStages:
    """Stages to send. renderings: the padded context views as the receiver could render them after the last."""

    stages: tuple[CodedStage, ...]
    renderings: Float[Tensor, "view 3 h w"]


def choose_stages(
    profile: Profile,
    scene: PreparedScene,
    matched: MatchedViews,
    lambda_q: int,
    refinement_steps: int = 0,
) -> ChosenStages:
    """Both stages, or the first alone where the context views' distortion does not fall by more than lambda times the
    second's bits a pixel, which is what the networks were trained for.

    All views or none: a view's own photograph says little of what views beside it lose without its second stage
    (docs/experiments.md).
    """
    every = tuple(range(scene.num_views))
    latents = analyse(profile, matched.features, start_state(profile, scene), lambda_q, 1)
    first = code_stage(profile, scene, latents, lambda_q, every, None)
    before = stage_rendering(profile, scene, first.state, lambda_q, 1)
    feedback = feedback_features(profile, scene, matched.depth, before, lambda_q)
    latents = analyse(profile, feedback, first.state, lambda_q, 2)
    latents = refine_second_stage(profile, scene, latents, first, lambda_q, refinement_steps)
    second = code_stage(profile, scene, latents, lambda_q, every, first)
    after = stage_rendering(profile, scene, second.state, lambda_q, 2).color
    gain = distortions(before.color, scene.images) - distortions(after, scene.images)
    price = dequantise_lambda(lambda_q) * bits_per_pixel(len(second.payload), scene)
    if float(gain.mean()) <= price:
        return ChosenStages((first,), before.color)
    return ChosenStages((first, second), after)


def bits_per_pixel(num_bytes: int, scene: PreparedScene) -> float:
    """Of the context views, without padding."""
    height, width = scene.image_size
    return 8.0 * num_bytes / (scene.num_views * height * width)
