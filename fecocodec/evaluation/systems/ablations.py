"""Ablations with the shipped weights: a part is removed at inference, without retraining.

They show how much the trained system depends on a part, not how well a system trained without it would perform. Latents
are optimised with the default effort. Only the sender changes, so the streams decode with the usual receiver. Gaussians
at other resolutions and a third stage would need other weights or another format.
"""

from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.systems.codec import stream_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with, write_scene
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import StageInputs, StageRendering


class WithoutContext(SceneEncoder):
    """Sender whose g_a takes S0 instead of S1 in stage 2."""

    def analyse(self, features: Tensor, inputs: StageInputs) -> Tensor:
        return super().analyse(features, replace(inputs, state=self.initial_state))


class WithoutFeedback(SceneEncoder):
    """Sender whose E_fb takes the photographs and the matched depth instead of those of stage 1: all errors are 0."""

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Tensor:
        return self.features_of_errors(self.images[0], self.matching.depth.relative_disparity, condition)


STAGE_1 = "stage-1"
WITHOUT: dict[str, tuple[str, type[SceneEncoder]]] = {  # option name -> (name of the curve, encoder)
    "no-context": ("no decoded context", WithoutContext),
    "no-feedback": ("no rendered feedback", WithoutFeedback),
}
ABLATIONS = (STAGE_1, *WITHOUT)
ABLATION_NAMES = ("stage 1 alone", *(name for name, _ in WITHOUT.values()))


def ablation_system(part: str, codec: Codec, lmbda: float, config: OptimisationConfig = DEFAULT) -> System:
    """Return the codec without stage 2 ("stage-1"), or without a part of it (a key of `WITHOUT`).

    config: of the latent optimisation.
    """
    lambda_q, setting = quantise_lambda(lmbda), f"lambda {lmbda:g}"
    if part == STAGE_1:
        encoder = partial(encode_with, codec, lambda_q=lambda_q, num_stages=1, config=config)
        return stream_system(codec, ABLATION_NAMES[0], setting, encoder)
    name, kind = WITHOUT[part]
    return stream_system(codec, name, setting, partial(_encode, codec, kind, lambda_q, config))


@torch.no_grad()
def _encode(
    codec: Codec, encoder: type[SceneEncoder], lambda_q: int, config: OptimisationConfig, views: Views
) -> bytes:
    scene = prepare_scene(views, codec.device)
    return write_scene(encoder(codec, scene.images, scene.cameras), scene, lambda_q, 2, config)
