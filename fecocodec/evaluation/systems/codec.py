"""The codec as a system under comparison: encode to bytes, decode them, and render.

Its operating points trade time for quality. Of models of three stages, whose last stage no stream holds, the quality of
all stages is measured with the size of their payloads.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import partial
from time import perf_counter

import torch
from torch import nn

from fecocodec.coding.camera_packing import unpack
from fecocodec.config import NO_CONTEXT, NO_FEEDBACK
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.perturbations import resized
from fecocodec.evaluation.summary import OURS
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.merging.grouping import DEFAULT_MERGING
from fecocodec.receiver.decode import decode_with, reconstruct
from fecocodec.receiver.state import State
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.ablations import without
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with, write_scene
from fecocodec.sender.optimisation_config import config_of_effort
from fecocodec.sender.precision import run_in_bfloat16
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import write_latents
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.splatting.emission import Emission

Encoder = Callable[[Views], bytes]
FAST, BEST, GUIDED = "fecosplat, effort fast", "fecosplat, effort best", "fecosplat, guided"
_NAME_OF_EFFORT = {"fast": FAST, "default": OURS, "best": BEST}


def codec_system(
    codec: Codec, lmbda: float, num_stages: int = 2, effort: str = "default", sharpness: float = 0.0
) -> System:
    """Return the codec at one lambda. num_stages, effort, sharpness: see `encode`."""
    name = _NAME_OF_EFFORT[effort] if num_stages == 2 else "stage 1 alone"
    config, lambda_q = config_of_effort(effort, sharpness), quantise_lambda(lmbda)
    encoder = partial(encode_with, codec, lambda_q=lambda_q, num_stages=num_stages, config=config)
    return System(name, f"lambda {lmbda:g}", partial(_reconstruct_and_report, codec, encoder))


def guided_system(codec: Codec, lmbda: float, num_stages: int = 2, effort: str = "default") -> System:
    """Return the codec at one lambda, taught by the guides of an entry. Other arguments as for `encode`."""
    config, lambda_q = config_of_effort(effort), quantise_lambda(lmbda)
    encoder = partial(encode_with, codec, lambda_q=lambda_q, num_stages=num_stages, config=config)
    reconstruct = partial(_reconstruct_and_report, codec, encoder)
    return System(GUIDED, f"lambda {lmbda:g}", reconstruct, learn=reconstruct)


def _reconstruct_and_report(
    codec: Codec, encoder: Callable[..., bytes], views: Views, num_context: int, guides: Views | None = None
) -> Reconstruction:
    """Return the reconstruction with the sender's warnings. encoder: has the arguments of `encode_with`."""
    warnings, omitted = list[str](), list[str]()

    def omit(sentence: str, names: tuple[str, ...]) -> None:
        warnings.append(sentence)
        omitted.extend(names)

    encoder = partial(encoder, guides=guides, on_warning=warnings.append, on_omission=omit)
    found = _reconstruct(codec, encoder, views, num_context)
    num_guides = 0 if guides is None else len(guides.names) - len(omitted)
    return replace(found, num_guides=num_guides, warnings=tuple(warnings))


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


def estimated_system(codec: Codec, lmbda: float) -> System:
    """Return all stages of a model at one lambda. The rate is estimated: the payloads, without header and cameras."""
    name = f"{OURS}, {codec.receiver.config.num_stages} stages, estimated rate"
    return System(name, f"lambda {lmbda:g}", partial(_reconstruct_all_stages, codec, quantise_lambda(lmbda)))


@torch.no_grad()
def _reconstruct_all_stages(codec: Codec, lambda_q: int, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    scene = prepare_scene(views.select(list(range(num_context))), codec.device)
    encoder = SceneEncoder.of(codec, scene)
    stages = encoder.run(torch.tensor([lambda_q]), codec.receiver.config.num_stages, write_latents(codec))
    num_bytes, last = sum(len(stage.coded.payload) for stage in stages), stages[-1]
    encoded = perf_counter()
    state, cameras = State(last.state, last.inputs.condition), unpack(scene.packed)
    emission = Emission(
        is_culled=True, background=DEFAULT_BACKGROUND, is_filled=encoder.is_filled, merging=DEFAULT_MERGING
    )
    gaussians = reconstruct(codec.receiver, state, cameras, emission)
    return rendered(gaussians, views, num_bytes, encoded - begin, perf_counter() - encoded, codec.device)


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


# Ablations: a part is removed at inference, without retraining, which shows how much the trained system depends on it,
# not how well one trained without it would perform. Only the sender changes, so the streams decode as usual.
STAGE_1 = "stage-1"
WITHOUT = {NO_CONTEXT: "no decoded context", NO_FEEDBACK: "no rendered feedback"}  # option -> name of the curve
ABLATIONS = (STAGE_1, *WITHOUT)
ABLATION_NAMES = ("stage 1 alone", *WITHOUT.values())


def ablation_system(part: str, codec: Codec, lmbda: float) -> System:
    """Return the codec without stage 2 ("stage-1"), or without a part of it (a key of `WITHOUT`)."""
    if part == STAGE_1:
        return codec_system(codec, lmbda, num_stages=1)
    encoder = partial(_encode, codec, part, quantise_lambda(lmbda))
    return stream_system(codec, WITHOUT[part], f"lambda {lmbda:g}", encoder)


@torch.no_grad()
def _encode(codec: Codec, part: str, lambda_q: int, views: Views) -> bytes:
    scene = prepare_scene(views, codec.device)
    encoder = without(part, SceneEncoder).of(codec, scene)
    return write_scene(encoder, scene, lambda_q, 2, config_of_effort("default"))
