"""The networks of the codec without coding: latents are not quantised, lambda is the smallest."""

import torch
from torch import Tensor

from fecocodec.coding.camera_packing import unpack
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.merging.grouping import DEFAULT_MERGING
from fecocodec.receiver.decode import reconstruct
from fecocodec.receiver.state import State
from fecocodec.sender.codec import Codec
from fecocodec.sender.latent_optimisation import optimiser
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import EstimatedLatent, Improvements, StageInputs
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.splatting.emission import Emission

FINEST_LAMBDA_Q = 0


@torch.no_grad()
def uncoded_gaussians(codec: Codec, views: Views, config: OptimisationConfig) -> Gaussians:
    """Predict the Gaussians from latents without quantisation, an upper bound for the coded system.

    config: of the latent optimisation towards these views, which minimises D alone.
    """
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    improve = Improvements(optimiser(encoder, config, without_coding, FINEST_LAMBDA_Q))
    last = encoder.run(torch.tensor([FINEST_LAMBDA_Q]), 2, without_coding, improve)[-1]
    state, cameras = State(last.state, last.inputs.condition), unpack(scene.packed)
    emission = Emission(
        is_culled=True, background=DEFAULT_BACKGROUND, is_filled=encoder.is_filled, merging=DEFAULT_MERGING
    )
    return reconstruct(codec.receiver, state, cameras, emission)


def without_coding(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
    """Return y unchanged, with zero bits."""
    return EstimatedLatent(y, y.new_zeros(len(y)))
