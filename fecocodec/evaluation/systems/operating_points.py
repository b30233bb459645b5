"""What a user may turn to trade seconds for quality: one curve over lambda for each."""

from copy import deepcopy
from functools import partial

import torch
from torch import nn

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.perturbations import resized
from fecocodec.evaluation.systems.codec import codec_system, stream_system
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.sender.encode import Profile, encode_with
from fecocodec.sender.precision import run_in_bfloat16

REFINEMENT_STEPS = (0, 1, 6)  # the default has four; of 16 a report has a curve anyway


def speed_systems(profile: Profile, lmbda: float) -> tuple[System, ...]:
    """The default; refinement steps; one stage; one thread; bfloat16; half the size."""
    setting, lambda_q = f"lambda {lmbda:g}", quantise_lambda(lmbda)
    default = codec_system(profile, lmbda)
    refined = (
        stream_system(profile, f"{count} refinement steps", setting, partial(_refined, profile, lambda_q, count))
        for count in REFINEMENT_STEPS
    )
    half = stream_system(profile, "half the size", setting, partial(_at_half_size, profile, lambda_q))
    single = System("one thread", setting, partial(_on_one_thread, default))
    narrow = in_bfloat16(profile)
    in_narrow = stream_system(narrow, "bfloat16", setting, partial(_plain, narrow, lambda_q))
    one_stage = codec_system(profile, lmbda, num_stages=1)
    return default, *refined, one_stage, single, in_narrow, half


def in_bfloat16(profile: Profile) -> Profile:
    """A copy of the networks whose convolutions and attention compute in bfloat16, at both ends."""
    copy = deepcopy(profile)
    networks = nn.ModuleDict({"sender": copy.sender, "receiver": copy.receiver})
    run_in_bfloat16(networks, next(networks.parameters()).device.type)
    return copy


def _plain(profile: Profile, lambda_q: int, views: Views) -> bytes:
    return encode_with(profile, views, lambda_q, 2)


def _refined(profile: Profile, lambda_q: int, count: int, views: Views) -> bytes:
    return encode_with(profile, views, lambda_q, 2, refinement_steps=count)


def _at_half_size(profile: Profile, lambda_q: int, views: Views) -> bytes:
    """Photographs of half the sides are coded; the Gaussians are drawn, and judged, at the whole size."""
    height, width = views.image_size
    return encode_with(profile, resized(views, height // 2, width // 2), lambda_q, 2)


def _on_one_thread(system: System, views: Views, num_context: int) -> Reconstruction:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return system.reconstruct(views, num_context)
    finally:
        torch.set_num_threads(threads)
