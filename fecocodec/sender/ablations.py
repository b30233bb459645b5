"""Encoders without a part of the method: senders that were trained without it, or without it at inference alone."""

from dataclasses import replace
from typing import TypeVar

from einops import rearrange
from torch import Tensor

from fecocodec.config import NO_CONTEXT, NO_FEEDBACK
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import StageInputs, StageRendering

Encoder = TypeVar("Encoder", bound=SceneEncoder)


class _WithoutContext(SceneEncoder):
    """g_a gets S0 in place of S1 in stage 2."""

    def analyse(self, features: Tensor, inputs: StageInputs) -> Tensor:
        return super().analyse(features, replace(inputs, state=self.initial_state))


class _WithoutFeedback(SceneEncoder):
    """E_fb gets the photographs and the matched depth in place of those of stage 1: all errors are 0."""

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Tensor:
        images = rearrange(self.images, "b v rgb h w -> (b v) rgb h w")
        return self.features_of_errors(images, self.matching.depth.relative_disparity, condition)


_PARTS: dict[str, type] = {NO_CONTEXT: _WithoutContext, NO_FEEDBACK: _WithoutFeedback}


def without(ablation: str, encoder: type[Encoder]) -> type[Encoder]:
    """Return the class of encoders without the parts that `ablation` names. Raises KeyError for others."""
    return type(encoder.__name__, (*(_PARTS[part] for part in ablation.split()), encoder), {}) if ablation else encoder
