"""The frame every network works in: origin at the mean camera centre, unit of length = the near bound."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians


@dataclass(frozen=True)
class SceneFrame:
    """How to come back from the normalised scene: `world = scale * normalised + origin`."""

    origin: Float[Tensor, "3"]  # float64
    scale: float  # scene units


def normalise_scene(cameras: Cameras) -> tuple[Cameras, SceneFrame]:
    """Cameras of the same scene with near = 1 and centres around the origin, so that neither the unit of length nor a
    far-away origin costs precision or changes what a network sees. One scene, no batch dimension."""
    centres = cameras.extrinsics[:, :3, 3].double()
    frame = SceneFrame(origin=centres.mean(dim=0), scale=float(cameras.near))
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, :3, 3] = ((centres - frame.origin) / frame.scale).float()
    near = torch.ones_like(cameras.near)
    far = (cameras.far.double() / frame.scale).float()
    return Cameras(extrinsics, cameras.intrinsics, near, far), frame


def denormalise_gaussians(gaussians: Gaussians, frame: SceneFrame) -> Gaussians:
    """Gaussians of the normalised scene in the world frame and unit of length of the original cameras."""
    means = (gaussians.means.double() * frame.scale + frame.origin.to(gaussians.means.device)).float()
    return Gaussians(
        means, gaussians.scales * frame.scale, gaussians.rotations, gaussians.opacities, gaussians.harmonics
    )
