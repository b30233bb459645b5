"""Camera poses inside the room of the stress suite: context views, then one target view.

All poses are camera-to-world matrices with OpenCV axes, in scene units.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def look(position: tuple[float, float, float], yaw_degrees: float = 0.0) -> Float[Tensor, "4 4"]:
    """Return the camera-to-world pose of a level camera; yaw 0 looks along +z, yaw 90 along +x."""
    yaw = math.radians(yaw_degrees)
    pose = torch.eye(4)
    pose[0, 0], pose[0, 2], pose[2, 0], pose[2, 2] = math.cos(yaw), math.sin(yaw), -math.sin(yaw), math.cos(yaw)
    pose[:3, 3] = torch.tensor(position)
    return pose


def _stack(*poses: Float[Tensor, "4 4"]) -> Float[Tensor, "view 4 4"]:
    return torch.stack(poses)


def sideways(baseline: float = 0.5) -> Float[Tensor, "view 4 4"]:
    """Two parallel cameras side by side; target half-way. baseline: in scene units."""
    return _stack(*(look((baseline * step, 0.1 * step * baseline, -1.5)) for step in (-0.5, 0.5, 0.0)))


def forwards() -> Float[Tensor, "view 4 4"]:
    """Forward motion: one camera behind the other; target half-way."""
    return _stack(look((0.0, 0.0, -1.8)), look((0.05, 0.0, -0.9)), look((0.02, 0.0, -1.35)))


def turning() -> Float[Tensor, "view 4 4"]:
    """Pure rotation about the camera centre: no parallax, so depth cannot be estimated."""
    return _stack(*(look((0.0, 0.0, -1.0), yaw) for yaw in (-8.0, 8.0, 0.0)))


def facing() -> Float[Tensor, "view 4 4"]:
    """Two cameras that face each other; target between them, with the orientation of the first."""
    return _stack(look((0.0, 0.0, -1.9)), look((0.0, 0.0, 1.9), 180.0), look((0.3, 0.0, -1.5)))


def back_to_back() -> Float[Tensor, "view 4 4"]:
    """Two cameras without common field of view."""
    return _stack(look((-0.2, 0.0, 0.0), -90.0), look((0.2, 0.0, 0.0), 90.0), look((-0.1, 0.0, 0.0), -90.0))


def along_a_line(count: int) -> Float[Tensor, "view 4 4"]:
    """`count` parallel context cameras, evenly spaced over a line of fixed length; target near its centre."""
    steps = torch.linspace(-0.5, 0.5, count).tolist() if count > 1 else [-0.25]
    return _stack(*(look((step, 0.05 * step, -1.5)) for step in (*steps, 0.02)))


def orbit(count: int) -> Float[Tensor, "view 4 4"]:
    """`count` context cameras on a full circle that look at its centre; target between the first two."""
    angles = [360.0 * step / count for step in (*range(count), 0.5)]
    return _stack(*(look((-math.sin(math.radians(a)), 0.0, -math.cos(math.radians(a))), a) for a in angles))


def with_far_view() -> Float[Tensor, "view 4 4"]:
    """Two parallel cameras side by side, and one at the other end of the room that faces them; target as `sideways`."""
    near = sideways()
    return torch.cat((near[:2], look((0.3, 0.0, 1.9), 170.0)[None], near[2:]))
