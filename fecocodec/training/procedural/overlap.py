"""Checks of camera paths: free positions and overlap of the views."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.images import Pinholes, cast_depth
from fecocodec.training.procedural.solids import World

_PROBE = 16
"""Shorter side in pixels of the depth maps of these checks."""


def is_inside(cameras: Pinholes, world: World) -> bool:
    """Return whether every camera is inside the room, with a margin to its walls."""
    gap = world.room_half - np.abs(cameras.eyes - world.room_centre)
    return bool((gap > np.minimum(0.15, 0.1 * world.room_half)).all())


def has_overlap(cameras: Pinholes, world: World, num_context: int, overlap: float) -> bool:
    """Return whether no camera is too near to a surface and neighbouring context views overlap by `overlap`."""
    scale = _PROBE / min(cameras.size)
    size = (round(cameras.size[0] * scale), round(cameras.size[1] * scale))
    centre = (cameras.centre[0] * scale, cameras.centre[1] * scale)
    probe = Pinholes(cameras.eyes, cameras.rotations, cameras.focal * scale, centre, size)
    depth = cast_depth(world, probe)
    nearest, middle = np.quantile(depth, 0.02, axis=(1, 2)), np.median(depth, axis=(1, 2))
    if (nearest < 0.12 * middle).any():
        return False
    pairs = [(view, view + 1) for view in range(num_context - 1)]
    return all(min(shared_view(probe, depth, i, j), shared_view(probe, depth, j, i)) >= overlap for i, j in pairs)


def shared_view(cameras: Pinholes, depth: Float[ndarray, "view height width"], first: int, second: int) -> float:
    """Return the share of the first view's pixels whose surface is visible in the second view."""
    height, width = cameras.size
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    rays = np.stack(((columns - cameras.centre[0]) / cameras.focal, (rows - cameras.centre[1]) / cameras.focal), -1)
    points = np.concatenate((rays, np.ones((height, width, 1))), -1) * depth[first][..., None]
    world = points @ cameras.rotations[first].T + cameras.eyes[first]
    seen = (world - cameras.eyes[second]) @ cameras.rotations[second]
    z = np.maximum(seen[..., 2], 1e-6)
    u = np.floor(cameras.centre[0] + cameras.focal * seen[..., 0] / z).astype(int)
    v = np.floor(cameras.centre[1] + cameras.focal * seen[..., 1] / z).astype(int)
    in_frame = (seen[..., 2] > 1e-3) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    visible_depth = depth[second][np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
    return float((in_frame & (z < visible_depth * 1.15)).mean())
