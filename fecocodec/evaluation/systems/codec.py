"""The codec as a system under comparison: encode to bytes, decode them, and render."""

from collections.abc import Callable
from functools import partial
from time import perf_counter

import torch

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.summary import OURS
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.optimisation_config import config_of_effort

Encoder = Callable[[Views], bytes]
FAST, BEST = "fecosplat, effort fast", "fecosplat, effort best"
_NAME_OF_EFFORT = {"fast": FAST, "default": OURS, "best": BEST}


def codec_system(
    codec: Codec, lmbda: float, num_stages: int = 2, effort: str = "default", sharpness: float = 0.0
) -> System:
    """Return the codec at one lambda. num_stages, effort, sharpness: see `encode`."""
    name = _NAME_OF_EFFORT[effort] if num_stages == 2 else "stage 1 alone"
    config, lambda_q = config_of_effort(effort, sharpness), quantise_lambda(lmbda)
    encoder = partial(encode_with, codec, lambda_q=lambda_q, num_stages=num_stages, config=config)
    return stream_system(codec, name, f"lambda {lmbda:g}", encoder)


def stream_system(codec: Codec, name: str, setting: str, encoder: Encoder) -> System:
    """Return a system that decodes the streams of any encoder. encoder: context views -> stream."""
    return System(name, setting, partial(_reconstruct, codec, encoder))


def _reconstruct(codec: Codec, encoder: Encoder, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    data = encoder(views.select(list(range(num_context))))
    encoded = perf_counter()
    gaussians = decode_with(codec.receiver, data).gaussians
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded, codec.device)


@torch.no_grad()
def rendered(
    gaussians: Gaussians,
    views: Views,
    num_bytes: int,
    encode_seconds: float,
    decode_seconds: float,
    device: torch.device = torch.device("cpu"),  # noqa: B008 - immutable
) -> Reconstruction:
    """Render Gaussians at the cameras of all views on a device, and return the reconstruction, on the CPU."""
    result = render(gaussians.to(device), views.cameras.to(device), views.image_size)
    images, depth = result.color.clamp(0, 1).cpu(), result.depth.cpu()
    return Reconstruction(num_bytes, encode_seconds, decode_seconds, gaussians, images, depth)
