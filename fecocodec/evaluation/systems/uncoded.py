"""The networks of the codec without coding: latents are not quantised, lambda is the smallest."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import PackedCameras
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
DECODED = Emission(is_culled=True, background=DEFAULT_BACKGROUND, merging=DEFAULT_MERGING)  # as `decode` emits


@dataclass(frozen=True)
class Uncoded:
    """The state of a scene after both stages, and its cameras. is_filled: see `Emission`."""

    state: State
    packed: PackedCameras
    is_filled: bool

    def emission(self, emission: Emission) -> Emission:
        """Return the emission, with the layer behind near surfaces if a decoder adds it."""
        return replace(emission, is_filled=self.is_filled)


@torch.no_grad()
def uncoded(codec: Codec, views: Views, config: OptimisationConfig) -> Uncoded:
    """Compute the state from latents without quantisation, an upper bound for the coded system.

    config: of the latent optimisation towards these views, which minimises D alone.
    """
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    num_steps = config.steps_of_stages(encoder.num_pixels, FINEST_LAMBDA_Q, is_taught=False)
    improve = Improvements(optimiser(encoder, config, without_coding, num_steps))
    last = encoder.run(torch.tensor([FINEST_LAMBDA_Q]), 2, without_coding, improve)[-1]
    return Uncoded(State(last.state, last.inputs.condition), scene.packed, encoder.is_filled)


def uncoded_gaussians(
    codec: Codec, views: Views, config: OptimisationConfig, emission: Emission = DECODED
) -> Gaussians:
    """Return the Gaussians of `uncoded`, in the world frame."""
    scene = uncoded(codec, views, config)
    return reconstruct(codec.receiver, scene.state, unpack(scene.packed), scene.emission(emission))


def without_coding(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
    """Return y unchanged, with zero bits."""
    return EstimatedLatent(y, y.new_zeros(len(y)))
