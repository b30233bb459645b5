"""The sender renders a scene as a decoder emits it, with the Gaussians behind near surfaces."""

import torch

from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.receiver.decode import decode
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode, write_stages
from fecocodec.sender.optimisation_config import FAST
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from tests.example_scenes import example_views

SIDE = 128


@torch.no_grad()
def test_the_feedback_shows_what_is_decoded() -> None:
    views, codec = example_views(2, SIDE, SIDE), load_codec(model_folder(None), "cpu")
    encoder = SceneEncoder.of(codec, prepare_scene(views, codec.device))
    last = write_stages(encoder, quantise_lambda(1e-3), 2, FAST)[-1]
    seen = encoder.render(last).scenes[0].color
    decoded, plain = (
        decode(encode(views, lmbda=1e-3, effort="fast"), **options) for options in ({}, {"background": None})
    )
    shown, without = (render(scene.gaussians, decoded.cameras, (SIDE, SIDE)).color for scene in (decoded, plain))
    assert float(psnr(seen, shown).mean()) > 60.0
    assert float(psnr(seen, without).mean()) < 57.0
