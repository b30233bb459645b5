"""The normalised frame, in which all networks work: origin at the mean camera centre, unit of length = near.

Camera centres and far are rounded to a grid in this frame (FORMAT.md, section 6.4). A change of the unit of length
changes cameras by rounding errors of float32; the grid removes them, so that the coded bits do not change.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians

CENTRE_STEPS = 2**13  # grid steps of a camera centre per near: rounding moves images by under 0.05 pixels
RATIO_BITS = 11  # significant bits of far / near


@dataclass(frozen=True)
class SceneFrame:
    """Transformation from the normalised frame to the world frame: `world = scale * normalised + origin`."""

    origin: Float[Tensor, "3"]  # float64, in scene units
    scale: float  # near, in scene units


def normalise_scene(cameras: Cameras) -> tuple[Cameras, SceneFrame]:
    """Transform the cameras of one scene (no batch dimension) to the normalised frame and round them.

    Returns the cameras and the transformation back to the world frame.
    """
    centres = cameras.extrinsics[:, :3, 3].double().cpu()
    near, far = float(cameras.near), float(cameras.far)
    origin = sum(centres[1:], start=centres[0]) / len(centres)
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, :3, 3] = _round((centres - origin) / near).to(extrinsics)
    ratio = _round_ratio(far / near)
    normalised = Cameras(
        extrinsics, cameras.intrinsics, torch.ones_like(cameras.near), torch.full_like(cameras.far, ratio)
    )
    return normalised, SceneFrame(origin, near)


def normalised_extrinsics(extrinsics: Float[Tensor, "view 4 4"], frame: SceneFrame) -> Float[Tensor, "view 4 4"]:
    """Return camera-to-world extrinsics of further cameras in the normalised frame, not rounded."""
    moved = extrinsics.clone()
    centres = extrinsics[:, :3, 3].double().cpu()
    moved[:, :3, 3] = ((centres - frame.origin) / frame.scale).to(extrinsics)
    return moved


def denormalise_gaussians(gaussians: Gaussians, frame: SceneFrame) -> Gaussians:
    """Transform Gaussians from the normalised frame to the world frame and unit of length of the original cameras."""
    means = (gaussians.means.double() * frame.scale + frame.origin.to(gaussians.means.device)).float()
    return Gaussians(
        means, gaussians.scales * frame.scale, gaussians.rotations, gaussians.opacities, gaussians.harmonics
    )


def _round(coordinates: Float[Tensor, "view 3"]) -> Float[Tensor, "view 3"]:
    """Round to the nearest grid point; ties round up."""
    return (CENTRE_STEPS * coordinates + 0.5).floor() / CENTRE_STEPS


def _round_ratio(ratio: float) -> float:
    """Round to `RATIO_BITS` significant bits; ties round up."""
    mantissa, exponent = math.frexp(ratio)  # mantissa in [0.5, 1)
    return math.ldexp(math.floor(mantissa * 2**RATIO_BITS + 0.5), exponent - RATIO_BITS)
