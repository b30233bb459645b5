"""Whether two cameras fit their photographs: how many points that look alike lie where the cameras say.

A point of one photograph lies on its epipolar line in the other. If more of them would with the second camera turned,
or with reversed axes, the poses are wrong. Turns that move points along their lines look like another depth.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.rotations import rotation_of_vector

_LARGEST_ERROR = 1 / 128  # of a point from its epipolar line, in longer image sides: 2 of 256 pixels
# Grids of turns, each around the best of the one before: step in degrees, steps to each side of the three axes, and
# factor of _LARGEST_ERROR. Small turns are also searched without the first.
_GRIDS = ((5.0, 3, 2.0), (1.7, 2, 1.3), (0.6, 2, 1.0))
_PRICE = 0.3  # of a radian, in shares: of turns that are almost as good, the smallest counts
# Chosen on pairs of training captures, with right cameras and wrong ones (docs/what_we_learned.md).
_LEAST_POINTS, _LEAST_SHARE, _LEAST_GAIN = 20, 0.4, 1.5


@dataclass(frozen=True)
class Fit:
    """Shares of `count` matches in place: with the cameras as given, with the best turn, with y and z axes reversed."""

    count: int
    given: float
    turned: float
    degrees: float
    axes_reversed: float

    @property
    def is_right(self) -> bool:
        return self._holds(self.given) and not self.is_turned

    @property
    def is_turned(self) -> bool:
        return self._is_better(self.turned)

    @property
    def has_reversed_axes(self) -> bool:
        return self._is_better(self.axes_reversed)

    def _holds(self, share: float) -> bool:
        return self.count * share >= _LEAST_POINTS and share >= _LEAST_SHARE

    def _is_better(self, share: float) -> bool:
        return self._holds(share) and share > _LEAST_GAIN * self.given


def fit_of(first: Float[Tensor, "match 2"], second: Float[Tensor, "match 2"], cameras: Cameras) -> Fit:
    """Return how the matches fit. first, second: (u, v) in [0, 1]. cameras: the two, apart from each other."""
    rays = tuple(_rays(points, matrix) for points, matrix in zip((first, second), cameras.intrinsics, strict=True))
    limit = _LARGEST_ERROR / float(cameras.intrinsics[:, :2, :2].diagonal(dim1=1, dim2=2).min())  # of the longer side
    extrinsics = cameras.extrinsics.double()

    def shares(poses: Tensor, turns: Float[Tensor, "turn 3"], factor: float = 1.0) -> Float[Tensor, " turn"]:
        return (_errors(rays, poses, rotation_of_vector(turns)) < factor * limit).double().mean(dim=1)

    def gain(turns: Float[Tensor, "turn 3"], factor: float = 1.0) -> Float[Tensor, " turn"]:
        return shares(extrinsics, turns, factor) - _PRICE * turns.norm(dim=1)

    none = torch.zeros(1, 3, dtype=torch.float64)
    given = float(shares(extrinsics, none)) if len(first) else 0.0
    if len(first) < _LEAST_POINTS:
        return Fit(len(first), given, given, 0.0, given)
    found = [none]
    for grids in (_GRIDS, _GRIDS[1:]):
        best = none
        for degrees, count, factor in grids:
            steps = math.radians(degrees) * torch.arange(-count, count + 1, dtype=torch.float64)
            turns = best + torch.cartesian_prod(steps, steps, steps)
            best = turns[gain(turns, factor).argmax()][None]
        found.append(best)
    candidates = torch.cat(found)
    best = candidates[gain(candidates).argmax()][None]
    turned = float(shares(extrinsics, best))
    opposite = torch.diag(extrinsics.new_tensor([1.0, -1.0, -1.0, 1.0]))
    axes_reversed = float(shares(extrinsics @ opposite, none))
    return Fit(len(first), given, turned, math.degrees(float(best.norm())), axes_reversed)


def _rays(points: Float[Tensor, "match 2"], intrinsics: Float[Tensor, "3 3"]) -> Float[Tensor, "match 3"]:
    """Return viewing rays (x, y, 1) in the frame of the camera."""
    homogeneous = torch.cat((points, torch.ones(len(points), 1)), dim=1).double()
    return homogeneous @ torch.linalg.inv(intrinsics.double()).T


def _errors(
    rays: tuple[Float[Tensor, "match 3"], ...], extrinsics: Float[Tensor, "2 4 4"], turns: Float[Tensor, "turn 3 3"]
) -> Float[Tensor, "turn match"]:
    """Return the Sampson distances (Hartley and Zisserman, 2003, section 11.4) with the second camera turned.

    They are in units of the focal length.
    """
    first, second = extrinsics
    to_second = turns.transpose(1, 2) @ second[:3, :3].T
    relative, shift = to_second @ first[:3, :3], to_second @ (first[:3, 3] - second[:3, 3])
    essential = torch.linalg.cross(shift[:, :, None].expand_as(relative), relative, dim=1)
    in_second, in_first = rays[0] @ essential.transpose(1, 2), rays[1] @ essential
    residual = (in_second * rays[1]).sum(dim=-1).abs()
    return residual / (in_second[..., :2].square().sum(-1) + in_first[..., :2].square().sum(-1)).sqrt().clamp_min(1e-12)
