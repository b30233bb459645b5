"""The Gaussians that a receiver emits: predicted from the last state, coloured, culled, in the world frame."""

import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.coding.kept_cells import is_in_kept_cell
from fecocodec.container import Header, Keep
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import denormalise_gaussians, normalise_scene
from fecocodec.geometry.padding import inside_unpadded, pad_cameras
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.view_states import ViewStates

LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians


def emit(
    receiver: Receiver, states: ViewStates, cameras: Cameras, header: Header, keep: Keep | None, sh_degree: int
) -> Gaussians:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`, on the CPU.

    cameras: of the context views, as the stream holds them. sh_degree: 0 or 1, see `decode`.
    """
    normalised, frame = normalise_scene(cameras)
    grid_cameras = pad_cameras(normalised, header.height, header.width).to(states.state.device)
    gaussians = predict(receiver, states, grid_cameras, sh_degree).to("cpu")
    gaussians = gaussians.keep(_is_drawable(gaussians) & _is_kept(header, keep, gaussians))
    return denormalise_gaussians(gaussians, frame)


def predict(receiver: Receiver, states: ViewStates, cameras: Cameras, sh_degree: int) -> Gaussians:
    """Predict the Gaussians of all grid cells and fit their view-dependent colours, in the frame of `cameras`."""
    prediction = receiver.predict(states.state, cameras.as_batch(), states.condition)
    return receiver.appearance(prediction, cameras) if sh_degree else prediction.gaussians.scene(0)


def _is_drawable(gaussians: Gaussians) -> Bool[Tensor, " n"]:
    return (gaussians.opacities >= LEAST_OPACITY) & gaussians.means.isfinite().all(dim=-1)


def _is_kept(header: Header, keep: Keep | None, gaussians: Gaussians) -> Bool[Tensor, " n"]:
    """Whether a Gaussian lies inside the unpadded image and the keep section emits it."""
    is_inside = inside_unpadded(header.num_views, header.height, header.width)
    if keep is None:
        return is_inside
    is_opaque = gaussians.opacities >= keep.opacity_threshold / 255.0
    return torch.logical_and(is_inside, is_opaque) & is_in_kept_cell(keep, header)
