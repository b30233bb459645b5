"""The codec itself, from real bytes, and the same networks without coding."""

from collections.abc import Callable
from functools import partial
from time import perf_counter

import torch

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.encode import Profile, encode_with
from fecocodec.sender.refinement import MANY_STEPS

Encoder = Callable[[Views], bytes]
THOROUGH = f"fecosplat, {MANY_STEPS} refinement steps"


def codec_system(profile: Profile, lmbda: float, num_stages: int = 2) -> System:
    """Encode the context views at this lambda, decode the bytes."""
    name = "fecosplat" if num_stages == 2 else "stage 1 alone"
    lambda_q = quantise_lambda(lmbda)
    return stream_system(
        profile, name, f"lambda {lmbda:g}", lambda views: encode_with(profile, views, lambda_q, num_stages)
    )


def thorough_system(profile: Profile, lmbda: float) -> System:
    """What patience buys: encode with many steps of refinement."""
    lambda_q = quantise_lambda(lmbda)
    encoder = partial(encode_with, profile, lambda_q=lambda_q, num_stages=2, refinement_steps=MANY_STEPS)
    return stream_system(profile, THOROUGH, f"lambda {lmbda:g}", encoder)


def stream_system(profile: Profile, name: str, setting: str, encoder: Encoder) -> System:
    """Any way of making a stream of the context views, decoded by the receiver."""
    return System(name, setting, partial(_reconstruct, profile, encoder))


def _reconstruct(profile: Profile, encoder: Encoder, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    data = encoder(views.select(list(range(num_context))))
    encoded = perf_counter()
    gaussians = decode_with(profile.receiver, data).gaussians
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)


@torch.no_grad()
def rendered(
    gaussians: Gaussians, views: Views, num_bytes: int, encode_seconds: float, decode_seconds: float
) -> Reconstruction:
    """The reconstruction that these Gaussians are."""
    seen = render(gaussians, views.cameras, views.image_size)
    return Reconstruction(num_bytes, encode_seconds, decode_seconds, gaussians, seen.color.clamp(0, 1), seen.depth)
