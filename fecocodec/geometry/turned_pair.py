"""Whether two photographs fit each other better if the second camera were turned, as with a wrong pose.

The camera is turned about the baseline and about its optical axis, both of which move the image off its epipolar lines.
A turn about the third axis moves it along them, which looks like another depth, so it is not searched.
"""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import consistent_depths, small_grey
from fecocodec.geometry.rotations import matrix_from_quaternion, multiply
from fecocodec.geometry.views import Views

_LONG_SIDE, _NUM_DEPTHS = 48, 64  # coarse, for speed
_STEPS = ((-6.0, -3.0, 3.0, 6.0), (-2.0, 2.0))  # degrees; about both axes, then again from the best
_LARGEST_FORWARD = 0.9  # cosine of baseline and optical axis; above it, the x axis takes the place of the baseline


@dataclass(frozen=True)
class Turn:
    """Best turn of the second camera. given, turned: share of pixels with a consistent depth, before and after it."""

    degrees: float
    given: float
    turned: float


def best_turn(pair: Views) -> Turn:
    """Search the turn with which two photographs agree best. Their cameras must be apart."""
    grey, cameras = small_grey(pair.images, _LONG_SIDE), pair.cameras

    def share(turn: Float[Tensor, "4"]) -> float:
        return len(consistent_depths(grey, _turned(cameras, turn), _NUM_DEPTHS)) / grey[0].numel()

    best = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)
    given = turned = share(best)
    for steps in _STEPS:
        for axis in _axes(cameras):
            start = best
            for degrees in steps:
                turn = multiply(start, _about(axis, degrees))
                if (found := share(turn)) > turned:
                    best, turned = turn, found
    return Turn(math.degrees(2.0 * math.acos(min(1.0, abs(float(best[0]))))), given, turned)


def _about(axis: Float[Tensor, "3"], degrees: float) -> Float[Tensor, "4"]:
    """Return the unit quaternion of a turn about a unit vector."""
    half = math.radians(degrees) / 2.0
    return torch.cat((axis.new_tensor([math.cos(half)]), math.sin(half) * axis))


def _axes(cameras: Cameras) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
    """Return unit vectors in the frame of the second camera: along the baseline, and the optical axis."""
    first, second = cameras.extrinsics.double()
    baseline = (first[:3, 3] - second[:3, 3]) @ second[:3, :3]
    baseline = baseline / baseline.norm()
    right, optical_axis = torch.eye(3, dtype=torch.float64)[[0, 2]]
    return right if baseline[2].abs() > _LARGEST_FORWARD else baseline, optical_axis


def _turned(cameras: Cameras, turn: Float[Tensor, "4"]) -> Cameras:
    extrinsics = cameras.extrinsics.clone()
    extrinsics[1, :3, :3] = extrinsics[1, :3, :3] @ matrix_from_quaternion(turn).to(extrinsics)
    return replace(cameras, extrinsics=extrinsics)
