"""Ablations that the shipped weights allow: a part is removed at inference, and nothing is trained again.

They measure how much the trained system depends on a part, not how well one trained without it would do. Latents are
optimised as by default. Every receiver decodes the streams, because only the sender differs. Gaussians at other
resolutions and a third stage are not among them: the predictor's head has four Gaussians a cell, and the format has
two stages.
"""

from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.systems.codec import codec_system, stream_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import assemble, write_stages
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder, StageInputs, StageRendering


class WithoutContext(SceneEncoder):
    """g_a of stage 2 gets S0 in place of S1."""

    def analyse(self, features: Tensor, inputs: StageInputs) -> Tensor:
        return super().analyse(features, replace(inputs, state=self.initial_state))


class WithoutFeedback(SceneEncoder):
    """E_fb gets the photographs and the matched depth in place of stage 1's, so that it sees no error."""

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Tensor:
        return self.features_of_errors(self.images[0], self.matching.depth.relative_disparity, condition)


STAGE_1 = "stage-1"
WITHOUT: dict[str, tuple[str, type[SceneEncoder]]] = {  # name of the curve
    "no-context": ("no decoded context", WithoutContext),
    "no-feedback": ("no rendered feedback", WithoutFeedback),
}
ABLATIONS = (STAGE_1, *WITHOUT)
ABLATION_NAMES = ("stage 1 alone", *(name for name, _ in WITHOUT.values()))


def ablation_system(part: str, codec: Codec, lmbda: float) -> System:
    """The codec without its second stage ("stage-1") or a part of it (`WITHOUT`)."""
    if part == STAGE_1:
        return codec_system(codec, lmbda, num_stages=1)
    name, encoder = WITHOUT[part]
    return stream_system(codec, name, f"lambda {lmbda:g}", partial(_encode, codec, encoder, quantise_lambda(lmbda)))


@torch.no_grad()
def _encode(codec: Codec, encoder: type[SceneEncoder], lambda_q: int, views: Views) -> bytes:
    scene = prepare_scene(views, codec.device)
    return assemble(codec, scene, write_stages(encoder(codec, scene.images, scene.cameras), lambda_q, 2, DEFAULT))
