"""Models of three stages, whose last stage no stream holds: quality of all stages, with the size of their payloads."""

from functools import partial
from time import perf_counter

import torch

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.summary import OURS
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import reconstruct
from fecocodec.receiver.state import State
from fecocodec.sender.codec import Codec
from fecocodec.sender.latent_coding import write_latents
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.splatting.emission import Emission


def estimated_system(codec: Codec, lmbda: float) -> System:
    """Return all stages of a model at one lambda. The rate is estimated: the payloads, without header and cameras."""
    name = f"{OURS}, {codec.receiver.config.num_stages} stages, estimated rate"
    return System(name, f"lambda {lmbda:g}", partial(_reconstruct, codec, quantise_lambda(lmbda)))


@torch.no_grad()
def _reconstruct(codec: Codec, lambda_q: int, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    scene = prepare_scene(views.select(list(range(num_context))), codec.device)
    encoder = SceneEncoder.of(codec, scene)
    stages = encoder.run(torch.tensor([lambda_q]), codec.receiver.config.num_stages, write_latents(codec))
    num_bytes, last = sum(len(stage.coded.payload) for stage in stages), stages[-1]
    encoded = perf_counter()
    state, cameras = State(last.state, last.inputs.condition), unpack(scene.packed)
    emission = Emission(is_culled=True, background=DEFAULT_BACKGROUND, is_filled=encoder.is_filled)
    gaussians = reconstruct(codec.receiver, state, cameras, emission)
    return rendered(gaussians, views, num_bytes, encoded - begin, perf_counter() - encoded, codec.device)
