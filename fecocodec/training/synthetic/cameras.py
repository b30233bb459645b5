"""Random camera paths like those of hand-held captures: orbits and walks, accepted if the context views overlap."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.synthetic.images import Pinholes, cast_depth
from fecocodec.training.synthetic.solids import Stage, World

_PROBE = 16
"""Shorter side in pixels of the depth maps of these checks."""

Pose = tuple[ndarray, ndarray]
"""Camera position and the point it looks at, in metres."""


@dataclass(frozen=True)
class PathRange:
    """Distribution of camera paths.

    baseline: distance of neighbouring context cameras, divided by their distance to what they view; log-uniform.
    overlap: least share of a context view that the neighbouring context view shows, too. fov: of the shorter side,
    degrees.
    """

    baseline: tuple[float, float] = (0.08, 0.9)
    overlap: float = 0.4
    fov: tuple[float, float] = (30.0, 85.0)


def place_cameras(
    rng: np.random.Generator, stage: Stage, path: PathRange, num_context: int, num_target: int, size: tuple[int, int]
) -> Pinholes:
    """Draw context cameras, then target cameras near and between them; size: (height, width) in pixels."""
    pinhole = _lens(rng, path, size)
    for _ in range(40):
        baseline = float(np.exp(rng.uniform(*np.log(path.baseline))))
        pose_at = _random_path(rng, stage)
        if pose_at is None:
            continue
        while baseline > 0.5 * path.baseline[0]:
            cameras = _along(rng, pose_at, baseline, num_context, num_target, pinhole)
            if is_inside(cameras, stage.world) and has_overlap(cameras, stage.world, num_context, path.overlap):
                return cameras
            baseline *= 0.75
    # No path is free: the middle of the room, looking along it, with little motion.
    middle = stage.world.room_centre
    ahead = middle + np.array([0.0, 0.0, 0.9 * stage.world.room_half[2]])
    step = np.array([0.1, 0.0, 0.0])
    return _along(rng, lambda t: (middle + t * step, ahead), 0.3, num_context, num_target, pinhole)


def _lens(rng: np.random.Generator, path: PathRange, size: tuple[int, int]) -> Pinholes:
    height, width = size
    low, high = (np.log(np.tan(np.radians(fov) / 2)) for fov in path.fov)
    focal = min(size) / 2 / float(np.exp(rng.uniform(low, high)))
    shift = rng.normal(0, 0.03, 2) * min(size)
    centre = (width / 2 + float(shift[0]), height / 2 + float(shift[1]))
    return Pinholes(np.zeros((0, 3)), np.zeros((0, 3, 3)), focal, centre, size)


def _random_path(rng: np.random.Generator, stage: Stage) -> Callable[[float], Pose] | None:
    """Return a path as a function of its length in units of the distance to the point it looks at; None if too near."""
    look = _point_of_interest(rng, stage)
    direction = rng.normal(0, 1, 3) * [1.0, 0.35, 1.0]
    direction[1] -= 0.3
    distance = float(np.exp(rng.uniform(*np.log(stage.distance))))
    eye = np.clip(look + distance * direction / np.linalg.norm(direction), stage.eye_low, stage.eye_high)
    distance = float(np.linalg.norm(eye - look))
    if distance < 0.5 * stage.distance[0]:
        return None
    kind = rng.random()
    if kind < 0.5:
        return _orbit(rng, eye, look)
    return _walk(rng, eye, look, turn=rng.uniform(0.0, 1.0) if kind < 0.85 else rng.uniform(-0.5, 1.5))


def _point_of_interest(rng: np.random.Generator, stage: Stage) -> Float[ndarray, "3"]:
    """Draw the centre of a solid (60%) or any point of the stage."""
    centres = stage.world.centres
    if len(centres) and rng.random() < 0.6:
        return np.clip(centres[int(rng.integers(len(centres)))], stage.look_low, stage.look_high)
    return rng.uniform(stage.look_low, stage.look_high)


def _orbit(rng: np.random.Generator, eye: Float[ndarray, "3"], look: Float[ndarray, "3"]) -> Callable[[float], Pose]:
    """Orbit around the point it looks at, about a nearly vertical axis, with drift in height and distance."""
    axis = np.array([0.0, 1.0, 0.0]) + rng.normal(0, 0.25, 3)
    axis /= np.linalg.norm(axis)
    drift, zoom = rng.normal(0, 0.15), rng.normal(0, 0.15)
    arm = eye - look
    distance = float(np.linalg.norm(arm))

    def pose_at(length: float) -> Pose:
        turned = (
            arm * np.cos(length) + np.cross(axis, arm) * np.sin(length) + axis * (axis @ arm) * (1 - np.cos(length))
        )
        return look + turned * (1 + zoom * length) + [0.0, drift * length * distance, 0.0], look

    return pose_at


def _walk(
    rng: np.random.Generator, eye: Float[ndarray, "3"], look: Float[ndarray, "3"], turn: float
) -> Callable[[float], Pose]:
    """Move in a straight line. turn: 0 keeps looking at the point, 1 keeps the direction."""
    distance = float(np.linalg.norm(look - eye))
    step = rng.normal(0, 1, 3) * [1.0, 0.4, 1.0]
    if rng.random() < 0.3:
        step = (look - eye) / distance + 0.3 * step
    step *= distance / np.linalg.norm(step)
    return lambda length: (eye + length * step, look + turn * length * step)


def _along(
    rng: np.random.Generator,
    pose_at: Callable[[float], Pose],
    baseline: float,
    num_context: int,
    num_target: int,
    pinhole: Pinholes,
) -> Pinholes:
    """Place cameras along a path, with jitter; targets are mostly between the context views, some just outside."""
    span = baseline * max(num_context - 1, 1)
    context = np.linspace(-0.5, 0.5, num_context) if num_context > 1 else np.zeros(1)
    lengths = np.concatenate((context, rng.uniform(-0.6, 0.6, num_target))) * span * rng.choice([-1.0, 1.0])
    roll = rng.normal(0, 0.06)
    poses = [pose_at(float(length)) for length in lengths]
    eyes, rotations = [], []
    for eye, look in poses:
        distance = float(np.linalg.norm(look - eye))
        eyes.append(eye + rng.normal(0, 0.06 * baseline * distance, 3))
        aim = look + rng.normal(0, 0.02 * distance, 3)
        rotations.append(_looking(aim - eyes[-1], roll + rng.normal(0, 0.015)))
    return Pinholes(np.stack(eyes), np.stack(rotations), pinhole.focal, pinhole.centre, pinhole.size)


def _looking(forward: Float[ndarray, "3"], roll: float) -> Float[ndarray, "3 3"]:
    """Return the camera-to-world rotation (columns right, down, forward) with a roll in radians about the level."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross([roll, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward), axis=1)


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
