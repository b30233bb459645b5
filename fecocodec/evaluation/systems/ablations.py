"""Ablations that the shipped weights allow: a part is taken away, or added, at inference, and nothing is retrained.

They say how much the trained system leans on a part, not how well one trained without it would do; whatever they leave
out, latents are refined, but for the one without refinement. All make streams
that every receiver decodes, because only the sender works differently. Gaussians at other resolutions and a third
stage are not among them: the predictor's head has four Gaussians a cell, and the format has two stages.
"""

from collections.abc import Callable
from functools import partial

import torch

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.systems.codec import codec_system, stream_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.sender.encode import Profile, assemble, encode_with
from fecocodec.sender.refinement import refine_stage, refined_first_latents, steps_of_first, suitable_steps
from fecocodec.sender.steps import (
    CodedStage,
    Latents,
    MatchedViews,
    PreparedScene,
    StageRendering,
    analyse,
    code_stage,
    feedback_features,
    first_stage_lambda_q,
    match_views,
    prepare,
    stage_rendering,
    start_state,
)

SecondLatents = Callable[[Profile, PreparedScene, MatchedViews, CodedStage, int], Latents]

STAGE_1, UNREFINED = "stage-1", "no-refinement"
UNREFINED_NAME = "no refinement"


def ablation_system(part: str, profile: Profile, lmbda: float) -> System:
    """The codec without the second stage ("stage-1"), its refinement ("no-refinement") or a part of it (`WITHOUT`)."""
    if part == STAGE_1:
        return codec_system(profile, lmbda, num_stages=1)
    lambda_q, setting = quantise_lambda(lmbda), f"lambda {lmbda:g}"
    if part == UNREFINED:
        unrefined = partial(encode_with, profile, lambda_q=lambda_q, num_stages=2, refinement_steps=0)
        return stream_system(profile, UNREFINED_NAME, setting, unrefined)
    name, second = WITHOUT[part]
    return stream_system(profile, name, setting, partial(_encode, profile, second, lambda_q))


def _without_context(
    profile: Profile, scene: PreparedScene, matched: MatchedViews, first: CodedStage, lambda_q: int
) -> Latents:
    """g_a of stage 2 gets S0 in the place of S1."""
    rendering = stage_rendering(profile, scene, first.after)
    features = feedback_features(profile, scene, matched.depth, rendering, lambda_q)
    return analyse(profile, features, start_state(profile, scene), lambda_q, 2)


def _without_rendering(
    profile: Profile, scene: PreparedScene, matched: MatchedViews, first: CodedStage, lambda_q: int
) -> Latents:
    """E_fb gets the photographs and matched depth in the place of stage 1's, so that no error is seen."""
    faultless = StageRendering(scene.images, matched.depth.relative_disparity)
    features = feedback_features(profile, scene, matched.depth, faultless, lambda_q)
    return analyse(profile, features, first.state, lambda_q, 2)


WITHOUT: dict[str, tuple[str, SecondLatents]] = {  # name of the curve
    "no-context": ("no decoded context", _without_context),
    "no-feedback": ("no rendered feedback", _without_rendering),
}
ABLATIONS = (STAGE_1, UNREFINED, *WITHOUT)
ABLATION_NAMES = ("stage 1 alone", UNREFINED_NAME, *(name for name, _ in WITHOUT.values()))


@torch.no_grad()
def _encode(profile: Profile, second: SecondLatents, lambda_q: int, views: Views) -> bytes:
    scene = prepare(profile, views)
    matched = match_views(profile, scene)
    num_steps, first_lambda_q = suitable_steps(scene, lambda_q), first_stage_lambda_q(lambda_q)
    latents = refined_first_latents(profile, scene, matched, first_lambda_q, steps_of_first(num_steps))
    first = code_stage(profile, scene, latents, first_lambda_q, None)
    latents = second(profile, scene, matched, first, lambda_q)
    latents = refine_stage(profile, scene, latents, first, lambda_q, num_steps)
    return assemble(profile, scene, (first, code_stage(profile, scene, latents, lambda_q, first)))
