"""Emit Gaussians: predict them from the last state, fit view-dependent colours, cull, transform to the world frame."""

from dataclasses import dataclass, replace

from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.config import PAPER
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.receiver.background import DEFAULT_BACKGROUND, BackgroundConfig, append, background_layer
from fecocodec.receiver.merging import MergingConfig, merged
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.occluded import occluded_layer
from fecocodec.receiver.state import State

LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians


@dataclass(frozen=True)
class EmissionConfig:
    """Options of the emitted Gaussians.

    sh_degree: degree of the spherical harmonics, 0 or 1. background: parameters of the background layer, None for no
    layer. merging: parameters for merging similar neighbours, None to emit every Gaussian.
    """

    sh_degree: int = 1
    background: BackgroundConfig | None = DEFAULT_BACKGROUND
    merging: MergingConfig | None = None


def emit(
    receiver: Receiver,
    state: State,
    cameras: Cameras,
    visibility: Float[Tensor, " n"] | None,
    config: EmissionConfig,
    is_filled: bool,
) -> Gaussians:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`, on the CPU.

    cameras: of the context views, as stored in the stream. visibility: factors in [0, 1] of the
    opacities, ordered (view, row, column); None for 1. The background layer comes last; the method "paper" has none.
    is_filled: whether the background layer has a part behind near surfaces, see `is_filled_behind`.
    """
    normalised, frame = normalise_scene(cameras)
    on_device = normalised.to(state.state.device)
    height, width = (receiver.config.gaussians_per_side * side for side in state.state.shape[-2:])
    prediction = receiver.predict(state.state, on_device.as_batch(), state.condition, state.detail)
    plain = prediction.gaussians.scene(0)
    gaussians = (receiver.appearance(prediction, on_device) if config.sh_degree else plain).to("cpu")
    if visibility is not None:
        gaussians = replace(gaussians, opacities=gaussians.opacities * visibility)
    is_emitted = _is_drawable(gaussians)
    if config.merging is None:
        emitted = gaussians.keep(is_emitted)
    else:
        emitted = merged(gaussians, is_emitted, (height, width), normalised, config.merging)
    if config.background is not None and receiver.config.method != PAPER:
        plain = replace(plain.to("cpu"), opacities=gaussians.opacities * is_emitted)
        emitted = append(emitted, background_layer(plain, normalised, (height, width), config.background))
        if is_filled:
            emitted = append(emitted, occluded_layer(plain, normalised, (height, width)))
    return denormalise_gaussians(emitted, frame)


def _is_drawable(gaussians: Gaussians) -> Bool[Tensor, " n"]:
    return (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)
