"""The Gaussians that a receiver emits: predicted from the last state, coloured, culled, in the world frame."""

from jaxtyping import Bool
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.state import State

LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians


def emit(
    receiver: Receiver, state: State, cameras: Cameras, is_covered: Bool[Tensor, " n"] | None, sh_degree: int
) -> Gaussians:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`, on the CPU.

    cameras: of the context views, as the stream holds them. is_covered: of all Gaussians of the 1/2 grids, ordered
    (view, row, column), False for those to drop; None: none. sh_degree: 0 or 1, see `decode`.
    """
    normalised, frame = normalise_scene(cameras)
    gaussians = predict(receiver, state, normalised.to(state.state.device), sh_degree).to("cpu")
    is_emitted = _is_drawable(gaussians) if is_covered is None else _is_drawable(gaussians) & is_covered
    gaussians = gaussians.keep(is_emitted)
    return denormalise_gaussians(gaussians, frame)


def predict(receiver: Receiver, state: State, cameras: Cameras, sh_degree: int) -> Gaussians:
    """Predict the Gaussians of all grid cells and fit their view-dependent colours, in the frame of `cameras`."""
    prediction = receiver.predict(state.state, cameras.as_batch(), state.condition)
    return receiver.appearance(prediction, cameras) if sh_degree else prediction.gaussians.scene(0)


def _is_drawable(gaussians: Gaussians) -> Bool[Tensor, " n"]:
    return (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)
