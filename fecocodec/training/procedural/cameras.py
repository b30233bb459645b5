"""Camera paths as people hold cameras: orbits, walks and free positions, accepted when the context views overlap."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.images import Pinholes
from fecocodec.training.procedural.layout import Stage
from fecocodec.training.procedural.overlap import is_inside, sees

Pose = tuple[ndarray, ndarray]
"""Position of the camera and the point that it looks at, metres."""


@dataclass(frozen=True)
class PathRange:
    """What paths are drawn from.

    baseline: distance between neighbouring context cameras over their distance to what they look at (log-uniform).
    overlap: least share of what one of two neighbouring context views shows that the other shows too.
    fov: of the shorter side, degrees.
    """

    baseline: tuple[float, float] = (0.08, 0.9)
    overlap: float = 0.4
    fov: tuple[float, float] = (30.0, 85.0)


def hold_cameras(
    rng: np.random.Generator, stage: Stage, path: PathRange, num_context: int, num_target: int, size: tuple[int, int]
) -> Pinholes:
    """Context cameras first, then target cameras near and between them; size is (height, width)."""
    pinhole = _lens(rng, path, size)
    for _ in range(40):
        baseline = float(np.exp(rng.uniform(*np.log(path.baseline))))
        pose_at = _random_path(rng, stage)
        if pose_at is None:
            continue
        while baseline > 0.5 * path.baseline[0]:
            cameras = _along(rng, pose_at, baseline, num_context, num_target, pinhole)
            if is_inside(cameras, stage.world) and sees(cameras, stage.world, num_context, path.overlap):
                return cameras
            baseline *= 0.75
    # Everything is in the way: the middle of the room, looking along it with hardly any motion.
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
    """A path as a function of the way along it in units of the distance to what it looks at; None if cramped."""
    look = _point_of_interest(rng, stage)
    direction = rng.normal(0, 1, 3) * [1.0, 0.35, 1.0]
    direction[1] -= 0.3
    distance = float(np.exp(rng.uniform(*np.log(stage.distance))))
    eye = np.clip(look + distance * direction / np.linalg.norm(direction), stage.eye_low, stage.eye_high)
    distance = float(np.linalg.norm(eye - look))
    if distance < 0.5 * stage.distance[0]:
        return None
    sort = rng.random()
    if sort < 0.5:
        return _orbit(rng, eye, look)
    return _walk(rng, eye, look, turn=rng.uniform(0.0, 1.0) if sort < 0.85 else rng.uniform(-0.5, 1.5))


def _point_of_interest(rng: np.random.Generator, stage: Stage) -> Float[ndarray, "3"]:
    """Mostly a solid, as people point cameras at things; else any point of the stage."""
    centres = stage.world.centres
    if len(centres) and rng.random() < 0.6:
        return np.clip(centres[int(rng.integers(len(centres)))], stage.look_low, stage.look_high)
    return rng.uniform(stage.look_low, stage.look_high)


def _orbit(rng: np.random.Generator, eye: Float[ndarray, "3"], look: Float[ndarray, "3"]) -> Callable[[float], Pose]:
    """Around the point that it looks at, about an axis near the vertical, drifting up or down, nearer or farther."""
    axis = np.array([0.0, 1.0, 0.0]) + rng.normal(0, 0.25, 3)
    axis /= np.linalg.norm(axis)
    drift, zoom = rng.normal(0, 0.15), rng.normal(0, 0.15)
    arm = eye - look
    distance = float(np.linalg.norm(arm))

    def pose_at(way: float) -> Pose:
        turned = arm * np.cos(way) + np.cross(axis, arm) * np.sin(way) + axis * (axis @ arm) * (1 - np.cos(way))
        return look + turned * (1 + zoom * way) + [0.0, drift * way * distance, 0.0], look

    return pose_at


def _walk(
    rng: np.random.Generator, eye: Float[ndarray, "3"], look: Float[ndarray, "3"], turn: float
) -> Callable[[float], Pose]:
    """In a straight line, sideways or forward; turn 0 keeps looking at the point, 1 keeps the direction."""
    distance = float(np.linalg.norm(look - eye))
    step = rng.normal(0, 1, 3) * [1.0, 0.4, 1.0]
    if rng.random() < 0.3:
        step = (look - eye) / distance + 0.3 * step
    step *= distance / np.linalg.norm(step)
    return lambda way: (eye + way * step, look + turn * way * step)


def _along(
    rng: np.random.Generator,
    pose_at: Callable[[float], Pose],
    baseline: float,
    num_context: int,
    num_target: int,
    pinhole: Pinholes,
) -> Pinholes:
    """Cameras on a path with a shaky hand; targets mostly between the context views, some just outside."""
    span = baseline * max(num_context - 1, 1)
    context = np.linspace(-0.5, 0.5, num_context) if num_context > 1 else np.zeros(1)
    ways = np.concatenate((context, rng.uniform(-0.6, 0.6, num_target))) * span * rng.choice([-1.0, 1.0])
    roll = rng.normal(0, 0.06)
    poses = [pose_at(float(way)) for way in ways]
    eyes, rotations = [], []
    for eye, look in poses:
        shake = float(np.linalg.norm(look - eye))
        eyes.append(eye + rng.normal(0, 0.06 * baseline * shake, 3))
        aim = look + rng.normal(0, 0.02 * shake, 3)
        rotations.append(_looking(aim - eyes[-1], roll + rng.normal(0, 0.015)))
    return Pinholes(np.stack(eyes), np.stack(rotations), pinhole.focal, pinhole.centre, pinhole.size)


def _looking(forward: Float[ndarray, "3"], roll: float) -> Float[ndarray, "3 3"]:
    """Camera-to-world rotation (columns right, down, forward) with the horizon level up to a roll in radians."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross([roll, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward), axis=1)
