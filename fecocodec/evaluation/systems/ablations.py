"""Ablations with the shipped weights: a part is removed at inference, without retraining.

They show how much the trained system depends on a part, not how well a system trained without it would perform. Latents
are optimised with the default effort. Only the sender changes, so the streams decode with the usual receiver. Gaussians
at other resolutions and a third stage would need other weights or another format.
"""

from functools import partial

import torch

from fecocodec.config import NO_CONTEXT, NO_FEEDBACK
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.systems.codec import stream_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.sender.ablations import without
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with, write_scene
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder

STAGE_1 = "stage-1"
WITHOUT = {NO_CONTEXT: "no decoded context", NO_FEEDBACK: "no rendered feedback"}  # option -> name of the curve
ABLATIONS = (STAGE_1, *WITHOUT)
ABLATION_NAMES = ("stage 1 alone", *WITHOUT.values())


def ablation_system(part: str, codec: Codec, lmbda: float, config: OptimisationConfig = DEFAULT) -> System:
    """Return the codec without stage 2 ("stage-1"), or without a part of it (a key of `WITHOUT`).

    config: of the latent optimisation.
    """
    lambda_q, setting = quantise_lambda(lmbda), f"lambda {lmbda:g}"
    if part == STAGE_1:
        encoder = partial(encode_with, codec, lambda_q=lambda_q, num_stages=1, config=config)
        return stream_system(codec, ABLATION_NAMES[0], setting, encoder)
    return stream_system(codec, WITHOUT[part], setting, partial(_encode, codec, part, lambda_q, config))


@torch.no_grad()
def _encode(codec: Codec, part: str, lambda_q: int, config: OptimisationConfig, views: Views) -> bytes:
    scene = prepare_scene(views, codec.device)
    return write_scene(without(part, SceneEncoder).of(codec, scene), scene, lambda_q, 2, config)
