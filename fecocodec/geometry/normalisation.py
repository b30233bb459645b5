"""The normalised frame of `scene_frame`, for tensors."""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.scene_frame import SceneFrame, normalise


def normalise_scene(cameras: Cameras) -> tuple[Cameras, SceneFrame]:
    """Transform the cameras of one scene (no batch dimension) to the normalised frame and round them.

    Returns the cameras and the transformation back to the world frame.
    """
    normalised, frame = normalise(cameras.arrays())
    return Cameras.of(normalised).to(cameras.extrinsics.device), frame


def normalised_extrinsics(extrinsics: Float[Tensor, "view 4 4"], frame: SceneFrame) -> Float[Tensor, "view 4 4"]:
    """Return camera-to-world extrinsics of further cameras in the normalised frame, not rounded."""
    moved = extrinsics.clone()
    centres = extrinsics[:, :3, 3].double().cpu()
    moved[:, :3, 3] = ((centres - torch.from_numpy(frame.origin)) / frame.scale).to(extrinsics)
    return moved


def denormalise_gaussians(gaussians: Gaussians, frame: SceneFrame) -> Gaussians:
    """Transform Gaussians from the normalised frame to the world frame and unit of length of the original cameras."""
    origin = torch.from_numpy(frame.origin).to(gaussians.means.device)
    means = (gaussians.means.double() * frame.scale + origin).float()
    return Gaussians(
        means, gaussians.scales * frame.scale, gaussians.rotations, gaussians.opacities, gaussians.harmonics
    )
