"""Operating points that trade time for quality; each gives one curve over lambda."""

from copy import deepcopy
from functools import partial

import torch
from torch import nn

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.perturbations import resized
from fecocodec.evaluation.systems.codec import codec_system, stream_system
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.precision import run_in_bfloat16


def speed_systems(codec: Codec, lmbda: float) -> tuple[System, ...]:
    """Return the codec with: default effort, fast effort, one stage, one thread, bfloat16, half the image size."""
    setting, lambda_q = f"lambda {lmbda:g}", quantise_lambda(lmbda)
    default = codec_system(codec, lmbda)
    fast = codec_system(codec, lmbda, effort="fast")
    half = stream_system(codec, "half the size", setting, partial(_at_half_size, codec, lambda_q))
    single = on_one_thread(default, setting)
    narrow = in_bfloat16(codec)
    in_narrow = stream_system(narrow, "bfloat16", setting, partial(encode_with, narrow, lambda_q=lambda_q))
    one_stage = codec_system(codec, lmbda, num_stages=1)
    return default, fast, one_stage, single, in_narrow, half


def in_bfloat16(codec: Codec) -> Codec:
    """Return a copy of the codec whose convolutions and attention compute in bfloat16, at both ends."""
    copy = deepcopy(codec)
    networks = nn.ModuleDict({"sender": copy.sender, "receiver": copy.receiver})
    run_in_bfloat16(networks, next(networks.parameters()).device.type)
    return copy


def _at_half_size(codec: Codec, lambda_q: int, views: Views) -> bytes:
    """Encode the views at half width and height. The Gaussians are rendered and compared at full size."""
    height, width = views.image_size
    return encode_with(codec, resized(views, height // 2, width // 2), lambda_q, 2)


def on_one_thread(system: System, setting: str) -> System:
    """The same system, encoding and decoding with one thread."""
    return System("one thread", setting, partial(_on_one_thread, system))


def _on_one_thread(system: System, views: Views, num_context: int) -> Reconstruction:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return system.reconstruct(views, num_context)
    finally:
        torch.set_num_threads(threads)
