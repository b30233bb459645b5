"""The Gaussians that a receiver emits: predicted from the last state, coloured, culled, in the world frame."""

from dataclasses import replace

from jaxtyping import Bool
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.receiver.background import BackgroundConfig, append, background_layer
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.state import State

LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians


def emit(
    receiver: Receiver,
    state: State,
    cameras: Cameras,
    is_covered: Bool[Tensor, " n"] | None,
    sh_degree: int,
    background: BackgroundConfig | None = None,
) -> Gaussians:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`, on the CPU.

    cameras: of the context views, as the stream holds them. is_covered: of all Gaussians of the 1/2 grids, ordered
    (view, row, column), False for those to drop; None: none. sh_degree: 0 or 1, see `decode`. background: of the
    background layer, which comes last; None: no layer.
    """
    normalised, frame = normalise_scene(cameras)
    on_device = normalised.to(state.state.device)
    prediction = receiver.predict(state.state, on_device.as_batch(), state.condition)
    plain = prediction.gaussians.scene(0)
    gaussians = (receiver.appearance(prediction, on_device) if sh_degree else plain).to("cpu")
    is_emitted = _is_drawable(gaussians) if is_covered is None else _is_drawable(gaussians) & is_covered
    emitted = gaussians.keep(is_emitted)
    if background is not None:
        height, width = (2 * side for side in state.state.shape[-2:])
        plain = replace(plain.to("cpu"), opacities=gaussians.opacities * is_emitted)
        emitted = append(emitted, background_layer(plain, normalised, (height, width), background))
    return denormalise_gaussians(emitted, frame)


def _is_drawable(gaussians: Gaussians) -> Bool[Tensor, " n"]:
    return (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)
