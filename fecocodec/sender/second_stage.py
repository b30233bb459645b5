"""Whether the second stage is worth its bytes."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fecocodec.container.lagrangian import dequantise_lambda
from fecocodec.sender.distortion import squared_error
from fecocodec.sender.encode import code_stages
from fecocodec.sender.steps import CodedStage, MatchedViews, PreparedScene, Profile, stage_rendering


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
    refinement_steps: int | None = None,
) -> ChosenStages:
    """One stage or two, whichever costs less: the context views' squared error and lambda times the bits a pixel.

    SSIM, which the networks were trained for, too, would take single stages that are finer, larger and worse in PSNR.
    All views or none: a view's own photograph says little of what views beside it lose without its second stage
    (docs/experiments.md).
    """
    candidates = []
    for num_stages in (1, 2):
        stages = code_stages(profile, scene, matched, lambda_q, num_stages, refinement_steps=refinement_steps)
        candidates.append(ChosenStages(stages, stage_rendering(profile, scene, stages[-1].after).color))
    return min(candidates, key=lambda chosen: _cost(scene, chosen, dequantise_lambda(lambda_q)))


def _cost(scene: PreparedScene, chosen: ChosenStages, lmbda: float) -> float:
    num_bytes = sum(len(stage.payload) for stage in chosen.stages)
    return squared_error(chosen.renderings, scene.images) + lmbda * bits_per_pixel(num_bytes, scene)


def bits_per_pixel(num_bytes: int, scene: PreparedScene) -> float:
    """Of the context views, without padding."""
    height, width = scene.image_size
    return 8.0 * num_bytes / (scene.num_views * height * width)
