"""A synthetic room, ray-traced analytically, for stress cases with arbitrary cameras and surfaces.

The camera is inside a box. Every ray hits one of the six faces, or a square sheet inside the room. Poses are
camera-to-world matrices with OpenCV axes, in scene units: context views, then one target view.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, pixel_rays
from fecocodec.geometry.views import Views

Paint = Callable[[Float[Tensor, "*pixel 3"]], Float[Tensor, "*pixel 3"]]

HALF_SIZE = torch.tensor([2.0, 1.3, 2.5])  # half the extent of the room along x, y, z, in scene units
SHEET_DEPTH, SHEET_HALF = 0.6, 0.9  # the sheet is a square in the plane z = SHEET_DEPTH, with this half side
BAR_PERIOD, BAR_WIDTH = 0.18, 0.02  # scene units
MOST_WAVES = 24
FOCAL = 0.8  # focal length, relative to the longer image side
SUPERSAMPLING = 2  # rays per pixel and axis


@dataclass(frozen=True)
class Room:
    """Materials of the room. paint: maps points on the walls to sRGB colours in [0, 1].

    transparency, reflection: of the sheet, in [0, 1]; a transparency of 1 means that there is no sheet. has_bars:
    whether the sheet is a grid of thin bars.
    """

    paint: Paint
    reflection: float = 0.0
    transparency: float = 1.0
    has_bars: bool = False


def painted(points: Float[Tensor, "*pixel 3"]) -> Float[Tensor, "*pixel 3"]:
    """Paint with enough texture to match every point of the walls."""
    return waves(points, MOST_WAVES)


def waves(points: Float[Tensor, "*pixel 3"], count: int) -> Float[Tensor, "*pixel 3"]:
    """Paint with a sum of `count` waves (1 to MOST_WAVES) of different directions, ordered by decreasing wavelength."""
    generator = torch.Generator().manual_seed(7)
    directions = torch.randn(MOST_WAVES, 3, generator=generator)
    directions = directions / directions.norm(dim=1, keepdim=True) * torch.logspace(0.3, 1.4, MOST_WAVES)[:, None]
    phases = 6.28 * torch.rand(MOST_WAVES, generator=generator)
    heights = torch.sin(points @ directions.T + phases) / torch.linspace(1.0, 3.0, MOST_WAVES)
    mix = torch.randn(MOST_WAVES, 3, generator=generator)
    return (0.5 + 0.16 * heights[..., :count] @ mix[:count]).clamp(0.02, 0.98)


def blank(points: Float[Tensor, "*pixel 3"]) -> Float[Tensor, "*pixel 3"]:
    """Paint with one constant grey per face: no texture to match."""
    face = (points.abs() / HALF_SIZE).argmax(dim=-1)
    grey = torch.tensor([0.55, 0.7, 0.62])[face] + 0.05 * (points.sum(dim=-1) > 0)
    return grey[..., None].expand(*points.shape)


def chequered(points: Float[Tensor, "*pixel 3"]) -> Float[Tensor, "*pixel 3"]:
    """Paint with a chequerboard: matches are ambiguous."""
    parity = (points * 4.0 + 0.01).floor().sum(dim=-1) % 2
    return (0.2 + 0.6 * parity)[..., None].expand(*points.shape)


def photograph(room: Room, extrinsics: Float[Tensor, "view 4 4"], size: tuple[int, int]) -> Views:
    """Render the room. extrinsics: camera-to-world poses inside the room. size: (height, width) in pixels."""
    height, width = size
    focal = FOCAL * max(size)
    intrinsics = torch.tensor([[focal / width, 0, 0.5], [0, focal / height, 0.5], [0, 0, 1]])
    cameras = Cameras(extrinsics, intrinsics.repeat(len(extrinsics), 1, 1), torch.tensor(0.25), torch.tensor(6.0))
    rays = pixel_rays(cameras, SUPERSAMPLING * height, SUPERSAMPLING * width)
    directions = (cameras.extrinsics[:, None, None, :3, :3] @ rays[..., None])[..., 0]
    origins = cameras.extrinsics[:, None, None, :3, 3].expand_as(directions)
    colours = _look(room, origins, directions).permute(0, 3, 1, 2)
    images = torch.nn.functional.avg_pool2d(colours, SUPERSAMPLING).clamp(0, 1)
    return Views(images, cameras, tuple(f"view {view}" for view in range(len(images))))


def _look(room: Room, origins: Tensor, directions: Tensor) -> Float[Tensor, "view height width 3"]:
    behind = room.paint(_wall(origins, directions))
    if room.transparency == 1.0:
        return behind
    t = (SHEET_DEPTH - origins[..., 2]) / directions[..., 2]
    hit = origins + t[..., None] * directions
    is_sheet = (t > 0) & (hit[..., :2].abs() < SHEET_HALF).all(dim=-1)
    if room.has_bars:
        is_sheet &= (hit[..., :2] % BAR_PERIOD < BAR_WIDTH).any(dim=-1)
    mirrored = directions * torch.tensor([1.0, 1.0, -1.0])
    reflected = room.paint(_wall(hit, mirrored))
    own = torch.tensor([0.1, 0.1, 0.12])
    body = room.reflection * reflected + (1 - room.reflection) * own
    sheet = room.transparency * behind + (1 - room.transparency) * body
    return torch.where(is_sheet[..., None], sheet, behind)


def _wall(origins: Tensor, directions: Tensor) -> Float[Tensor, "view height width 3"]:
    """Return the points where rays from inside the box hit its faces."""
    safe = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    distance = ((torch.sign(safe) * HALF_SIZE - origins) / safe).amin(dim=-1, keepdim=True)
    return origins + distance * directions


def look(position: tuple[float, float, float], yaw_degrees: float = 0.0) -> Float[Tensor, "4 4"]:
    """Return the camera-to-world pose of a level camera; yaw 0 looks along +z, yaw 90 along +x."""
    yaw = math.radians(yaw_degrees)
    pose = torch.eye(4)
    pose[0, 0], pose[0, 2], pose[2, 0], pose[2, 2] = math.cos(yaw), math.sin(yaw), -math.sin(yaw), math.cos(yaw)
    pose[:3, 3] = torch.tensor(position)
    return pose


def sideways(baseline: float = 0.5) -> Float[Tensor, "view 4 4"]:
    """Two parallel cameras side by side; target half-way. baseline: in scene units."""
    return torch.stack([look((baseline * step, 0.1 * step * baseline, -1.5)) for step in (-0.5, 0.5, 0.0)])


def forwards() -> Float[Tensor, "view 4 4"]:
    """Forward motion: one camera behind the other; target half-way."""
    return torch.stack((look((0.0, 0.0, -1.8)), look((0.05, 0.0, -0.9)), look((0.02, 0.0, -1.35))))


def turning() -> Float[Tensor, "view 4 4"]:
    """Pure rotation about the camera centre: no parallax, so depth cannot be estimated."""
    return torch.stack([look((0.0, 0.0, -1.0), yaw) for yaw in (-8.0, 8.0, 0.0)])


def facing() -> Float[Tensor, "view 4 4"]:
    """Two cameras that face each other; target between them, with the orientation of the first."""
    return torch.stack((look((0.0, 0.0, -1.9)), look((0.0, 0.0, 1.9), 180.0), look((0.3, 0.0, -1.5))))


def back_to_back() -> Float[Tensor, "view 4 4"]:
    """Two cameras without common field of view."""
    return torch.stack((look((-0.2, 0.0, 0.0), -90.0), look((0.2, 0.0, 0.0), 90.0), look((-0.1, 0.0, 0.0), -90.0)))


def along_a_line(count: int) -> Float[Tensor, "view 4 4"]:
    """`count` parallel context cameras, evenly spaced over a line of fixed length; target near its centre."""
    steps = torch.linspace(-0.5, 0.5, count).tolist() if count > 1 else [-0.25]
    return torch.stack([look((step, 0.05 * step, -1.5)) for step in (*steps, 0.02)])


def orbit(count: int) -> Float[Tensor, "view 4 4"]:
    """`count` context cameras on a full circle that look at its centre; target between the first two."""
    angles = [360.0 * step / count for step in (*range(count), 0.5)]
    return torch.stack([look((-math.sin(math.radians(a)), 0.0, -math.cos(math.radians(a))), a) for a in angles])


def with_far_view() -> Float[Tensor, "view 4 4"]:
    """Two parallel cameras side by side, and one at the other end of the room that faces them; target as `sideways`."""
    near = sideways()
    return torch.cat((near[:2], look((0.3, 0.0, 1.9), 170.0)[None], near[2:]))
