"""Whether two cameras fit their photographs: how many corners that look alike lie where the cameras say.

A point of one photograph lies on its epipolar line in the other. If more of them would with the second camera turned,
or with reversed axes, the poses are wrong. Turns that move points along their lines look like another depth.

Points that look alike are corners (Shi and Tomasi, "Good features to track", 1994) with upright histograms of
gradients (Lowe, "Distinctive image features from scale-invariant keypoints", 2004: descriptors of 4x4 cells with 8
directions, and the ratio of distances).
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

_LARGEST_ERROR = 1 / 128  # of a point from its epipolar line, in longer image sides: 2 of 256 pixels
# Grids of turns, each around the best of the one before: step in degrees, steps to each side of the three axes, and
# factor of _LARGEST_ERROR. Small turns are also searched without the first.
_GRIDS = ((5.0, 3, 2.0), (1.7, 2, 1.3), (0.6, 2, 1.0))
_PRICE = 0.3  # of a radian, in shares: of turns that are almost as good, the smallest counts
# Chosen on pairs of training captures, with right cameras and wrong ones (docs/what_we_learned.md).
_LEAST_POINTS, _LEAST_SHARE, _LEAST_GAIN = 20, 0.4, 1.5
_LONG_SIDE = 256  # pixels of the images in which corners are searched
_MOST_CORNERS = 500
_LEAST_CORNER = 1e-6  # smaller eigenvalue of the gradients' mean products, of grey values in [0, 1]
_SEPARATION = 7  # pixels, side of the square in which a corner is the strongest
_CELLS = (-6, -2, 2, 6)  # pixels, centres of the cells of a descriptor
_BORDER = 10  # pixels
_DIRECTIONS = 8
_MOST_OF_A_CELL = 0.2  # of a descriptor of unit length, against single strong edges
_MOST_RATIO = 0.9  # of the angles between a descriptor and its nearest and second nearest


@dataclass(frozen=True)
class Corners:
    """Corners of one photograph. positions: (u, v) in [0, 1]. descriptors: of unit length."""

    positions: Float[Tensor, "corner 2"]
    descriptors: Float[Tensor, "corner value"]


@torch.no_grad()
def find_corners(image: Float[Tensor, "3 height width"], ignored: Bool[Tensor, "height width"] | None) -> Corners:
    """Return the strongest corners of an image. ignored: pixels without corners."""
    scale = _LONG_SIDE / max(image.shape[-2:])
    size = [round(side * scale) for side in image.shape[-2:]]
    grey = F.interpolate(image.mean(dim=0)[None, None], size, mode="bilinear", antialias=True, align_corners=False)
    rows, columns = _gradients(_smoothed(grey, 1))
    strength = _smaller_eigenvalue(rows, columns)
    if ignored is not None:
        is_ignored = F.interpolate(ignored[None, None].float(), size, mode="nearest") > 0
        strength = strength.masked_fill(is_ignored, 0.0)
    inner = strength[..., _BORDER:-_BORDER, _BORDER:-_BORDER]
    is_strongest = F.max_pool2d(inner, _SEPARATION, stride=1, padding=_SEPARATION // 2) == inner
    values, index = (inner * is_strongest).flatten().topk(min(_MOST_CORNERS, inner.numel()))
    index = index[values > _LEAST_CORNER]
    y, x = index // inner.shape[-1] + _BORDER, index % inner.shape[-1] + _BORDER
    cells = _smoothed(_direction_maps(rows, columns), 3)
    values = torch.cat([cells[0, :, y + down, x + right] for down in _CELLS for right in _CELLS]).T
    descriptors = F.normalize(F.normalize(values, dim=1).clamp(max=_MOST_OF_A_CELL), dim=1)
    return Corners((torch.stack((x, y), dim=1) + 0.5) / torch.tensor([size[1], size[0]]), descriptors)


def match_corners(first: Corners, second: Corners) -> tuple[Float[Tensor, "match 2"], Float[Tensor, "match 2"]]:
    """Return the positions of corners that are each other's nearest, and clearly nearer than the next one."""
    if min(len(first.positions), len(second.positions)) < 2:
        return first.positions[:0], second.positions[:0]
    angles = torch.acos((first.descriptors @ second.descriptors.T).clamp(-1, 1))
    nearest, index = angles.topk(2, dim=1, largest=False)
    is_mutual = angles.argmin(dim=0)[index[:, 0]] == torch.arange(len(angles))
    is_match = is_mutual & (nearest[:, 0] < _MOST_RATIO * nearest[:, 1])
    return first.positions[is_match], second.positions[index[is_match, 0]]


def _gradients(grey: Float[Tensor, "1 1 h w"]) -> tuple[Float[Tensor, "1 1 h w"], Float[Tensor, "1 1 h w"]]:
    """Return central differences, down and to the right."""
    rows, columns = torch.gradient(grey, dim=(2, 3))
    return rows, columns


def _smaller_eigenvalue(rows: Float[Tensor, "1 1 h w"], columns: Float[Tensor, "1 1 h w"]) -> Float[Tensor, "1 1 h w"]:
    """Return the smaller eigenvalue of the mean products of gradients around each pixel."""
    products = _smoothed(torch.cat((rows * rows, columns * columns, rows * columns), dim=1), 2)
    down, right, mixed = products.split(1, dim=1)
    return (down + right) / 2 - ((down - right).square() / 4 + mixed.square()).sqrt()


def _direction_maps(
    rows: Float[Tensor, "1 1 h w"], columns: Float[Tensor, "1 1 h w"]
) -> Float[Tensor, "1 direction h w"]:
    """Return the length of each gradient, shared between the two nearest of _DIRECTIONS directions."""
    position = torch.atan2(rows, columns) * (_DIRECTIONS / (2 * math.pi)) % _DIRECTIONS
    directions = torch.arange(float(_DIRECTIONS))[:, None, None]
    distance = ((position - directions + _DIRECTIONS / 2) % _DIRECTIONS - _DIRECTIONS / 2).abs()
    return torch.hypot(rows, columns) * (1 - distance).clamp_min(0)


def _smoothed(maps: Float[Tensor, "1 channel h w"], radius: int) -> Float[Tensor, "1 channel h w"]:
    """Return the maps after two means over squares, each of the side 2 `radius` + 1."""
    side = 2 * radius + 1
    for window in 2 * ((1, side), (side, 1)):
        padding = (window[0] // 2, window[1] // 2)
        maps = F.avg_pool2d(maps, window, stride=1, padding=padding, count_include_pad=False)
    return maps


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
        return (_errors(rays, poses, _rotations(turns)) < factor * limit).double().mean(dim=1)

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


def _rotations(axis_angles: Float[Tensor, "turn 3"]) -> Float[Tensor, "turn 3 3"]:
    """Return the rotations of axis times angle in radians."""
    x, y, z = axis_angles.unbind(1)
    zero = torch.zeros_like(x)
    return torch.linalg.matrix_exp(torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=1).view(-1, 3, 3))
