"""Which views the second stage is worth its bytes for."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.container.lagrangian import dequantise_lambda
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.distortion import distortions
from fecocodec.sender.refinement import refine_second_stage
from fecocodec.sender.steps import (
    CodedStage,
    Latents,
    PreparedScene,
    Profile,
    analyse,
    code_stage,
    feedback_features,
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
    features: Float[Tensor, "view channel h4 w4"],
    lambda_q: int,
    refinement_steps: int = 0,
) -> ChosenStages:
    """Code both stages, then send of the second what pays: for each view its distortion must fall by more than lambda
    times its bits a pixel, which is what the networks were trained for.
    """
    every = tuple(range(scene.num_views))
    latents = analyse(profile, features, start_state(profile, scene), lambda_q, 1)
    first = code_stage(profile, scene, latents, lambda_q, every, None)
    before = _rendering(profile, scene, first)
    feedback = feedback_features(profile, scene, before, lambda_q)
    latents = analyse(profile, feedback, first.state, lambda_q, 2)
    latents = refine_second_stage(profile, scene, latents, first, lambda_q, refinement_steps)
    second = code_stage(profile, scene, latents, lambda_q, every, first)
    after = _rendering(profile, scene, second)
    gain = distortions(before, scene.images) - distortions(after, scene.images)
    price = dequantise_lambda(lambda_q) * _bits_per_pixel(profile, scene, latents, lambda_q, first)
    views = tuple(view for view in every if gain[view] > price[view])
    if views == every:
        return ChosenStages((first, second), after)
    if not views:
        return ChosenStages((first,), before)
    part = latents.of_views(views)
    second = code_stage(profile, scene, part, lambda_q, views, first)
    return ChosenStages((first, second), _rendering(profile, scene, second))


def _rendering(profile: Profile, scene: PreparedScene, coded: CodedStage) -> Float[Tensor, "view 3 h w"]:
    """The padded context views as the receiver could render them after this stage."""
    cameras, size = scene.cameras, (scene.images.shape[-2], scene.images.shape[-1])
    prediction = profile.receiver.predict(coded.state, cameras.as_batch(), coded.after.condition)
    return render(prediction.gaussians.scene(0), cameras, size).color


def _bits_per_pixel(
    profile: Profile, scene: PreparedScene, latents: Latents, lambda_q: int, first: CodedStage
) -> Float[Tensor, " view"]:
    """What each view's part of stage 2 costs when it is coded alone, a pixel of that view."""
    height, width = scene.image_size
    sizes = [
        len(code_stage(profile, scene, latents.of_views((view,)), lambda_q, (view,), first).payload)
        for view in range(scene.num_views)
    ]
    return 8.0 * torch.tensor(sizes, device=scene.images.device) / (height * width)
