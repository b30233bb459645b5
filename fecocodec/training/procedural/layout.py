"""Random worlds: rooms, table tops, open ground and floating solids, from bare to crowded."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.furniture import INDOOR_PROPS, OUTDOOR_PROPS, table
from fecocodec.training.procedural.lights import indoor_lights, sunlight
from fecocodec.training.procedural.materials import Palette
from fecocodec.training.procedural.props import clutter, floating
from fecocodec.training.procedural.solids import BOX, Builder, World, yaw_rotation


@dataclass(frozen=True)
class Stage:
    """A world and the boxes (corners in metres, y down, floor at 0) of camera positions and of points to look at.

    distance: range of the distance between camera and point, in metres.
    """

    world: World
    eye_low: Float[ndarray, "3"]
    eye_high: Float[ndarray, "3"]
    look_low: Float[ndarray, "3"]
    look_high: Float[ndarray, "3"]
    distance: tuple[float, float]


def lay_out(rng: np.random.Generator, num_textures: int, complexity: float) -> Stage:
    """Draw a random world. complexity: 0 (bare walls) to 1 (crowded)."""
    layout = _LAYOUTS[int(rng.choice(len(_LAYOUTS), p=_SHARES))]
    return layout(rng, Palette(rng, num_textures), complexity)


def _count(rng: np.random.Generator, complexity: float, most: int) -> int:
    """Draw a number of props that grows with complexity."""
    return round(most * complexity * float(rng.uniform(0.6, 1.0)))


def _room(rng: np.random.Generator, palette: Palette, complexity: float) -> Stage:
    """A furnished room or corridor with pictures, doors and windows on the walls."""
    builder = Builder()
    half = np.array([rng.uniform(1.3, 4.0), rng.uniform(1.1, 1.6), rng.uniform(1.5, 5.0)])
    centre = np.array([0.0, -half[1], 0.0])
    for _ in range(_count(rng, complexity, 9)):
        prop = INDOOR_PROPS[int(rng.integers(len(INDOOR_PROPS)))]
        x, z = rng.uniform(-0.95, 0.95, 2) * half[[0, 2]]
        prop(rng, builder, palette, (float(x), 0.0, float(z)))
    for _ in range(_count(rng, complexity, 9)):
        _on_wall(rng, builder, palette, half)
    for _ in range(_count(rng, complexity, 8)):
        x, z = rng.uniform(-0.9, 0.9, 2) * half[[0, 2]]
        clutter(rng, builder, palette, (float(x), 0.0, float(z)), rng.uniform(0.08, 0.3))
    wall = palette.wall(2 * half[2])
    walls = [wall if rng.random() < 0.7 else palette.wall(2 * half[2]) for _ in range(4)]
    faces = [walls[0], walls[1], palette.wall(2 * half[0]), palette.wall(2 * half[0]), walls[2], walls[3]]
    world = builder.build((centre, half), faces, indoor_lights(rng, half))
    eye_low, eye_high = centre - half * [0.85, 0.65, 0.85], centre + half * [0.85, 0.4, 0.85]
    look_low, look_high = centre - half * [0.95, 0.5, 0.95], centre + half * [0.95, 0.95, 0.95]
    return Stage(world, eye_low, eye_high, look_low, look_high, (1.0, 6.0))


def _on_wall(rng: np.random.Generator, builder: Builder, palette: Palette, half: Float[ndarray, "3"]) -> None:
    """A picture, board, door or window: flat boxes on one of the four walls."""
    wall = int(rng.integers(4))
    along = half[2] if wall < 2 else half[0]
    size = (rng.uniform(0.15, 0.7), rng.uniform(0.15, 0.6))
    height = -rng.uniform(size[1], 2 * half[1] - size[1])
    position = float(rng.uniform(-0.9, 0.9) * along)
    side = -1.0 if wall % 2 else 1.0
    x, z = (side * half[0], position) if wall < 2 else (position, side * half[2])
    rotation = yaw_rotation(np.pi / 2 if wall < 2 else 0.0)
    sort = rng.random()
    material = palette.lamp() if sort < 0.1 else palette.picture(size) if sort < 0.8 else palette.prop(2 * size[0])
    builder.add(BOX, (float(x), height, float(z)), (*size, rng.uniform(0.01, 0.06)), rotation, material)
    if rng.random() < 0.5:
        frame = (size[0] + 0.05, size[1] + 0.05, 0.008)
        builder.add(BOX, (float(x), height, float(z)), frame, rotation, palette.prop(0.4))


def _table_top(rng: np.random.Generator, palette: Palette, complexity: float) -> Stage:
    """Small things close together on a large flat surface, with a room around."""
    builder = Builder()
    half = np.array([rng.uniform(1.0, 4.0), rng.uniform(0.8, 1.8), rng.uniform(1.0, 4.0)])
    level = 0.0
    if rng.random() < 0.6:
        level = -rng.uniform(0.3, 0.7)
        top = (rng.uniform(0.3, 1.0), 0.02, rng.uniform(0.3, 0.8))
        builder.add(BOX, (0.0, level + 0.02, 0.0), top, yaw_rotation(rng.uniform(0.0, 6.3)), palette.wall(2 * top[0]))
        builder.add(BOX, (0.0, level / 2 + 0.04, 0.0), (0.15, -level / 2, 0.15), np.eye(3), palette.prop(0.5))
    clutter(rng, builder, palette, (0.0, level, 0.0), rng.uniform(0.1, 0.3))
    for _ in range(_count(rng, complexity, 20)):
        x, z = rng.normal(0.0, 0.22, 2)
        clutter(rng, builder, palette, (float(x), level, float(z)), rng.uniform(0.03, 0.18))
    for _ in range(_count(rng, complexity, 5)):
        prop = INDOOR_PROPS[int(rng.integers(len(INDOOR_PROPS)))]
        angle, far = rng.uniform(0.0, 6.3), rng.uniform(0.75, 0.95)
        x, z = far * half[0] * np.cos(angle), far * half[2] * np.sin(angle)
        prop(rng, builder, palette, (float(x), 0.0, float(z)))
    faces = [palette.wall(2 * half[0]) for _ in range(6)]
    world = builder.build((np.array([0.0, -half[1], 0.0]), half), faces, indoor_lights(rng, half))
    eye_low, eye_high = np.array([-0.9, -1.9, -0.9]) * half, np.array([0.9 * half[0], level - 0.08, 0.9 * half[2]])
    look_low, look_high = np.array([-0.1, level - 0.3, -0.1]), np.array([0.1, level, 0.1])
    return Stage(world, eye_low, eye_high, look_low, look_high, (0.45, 1.6))


def _open_ground(rng: np.random.Generator, palette: Palette, complexity: float) -> Stage:
    """Houses, trees and props under the sky, or a square between facades."""
    builder = Builder()
    half = np.array([rng.uniform(8, 25), rng.uniform(5, 15), rng.uniform(8, 25)])
    for _ in range(1 + _count(rng, complexity, 10)):
        prop = OUTDOOR_PROPS[int(rng.integers(len(OUTDOOR_PROPS)))]
        angle, far = rng.uniform(0.0, 6.3), rng.uniform(0.0, 0.8) ** 0.7
        x, z = far * half[0] * np.cos(angle), far * half[2] * np.sin(angle)
        prop(rng, builder, palette, (float(x), 0.0, float(z)))
    for _ in range(_count(rng, complexity, 12)):
        x, z = rng.normal(0.0, 1.5, 2)
        clutter(rng, builder, palette, (float(x), 0.0, float(z)), rng.uniform(0.1, 0.6))
    sky, ground = palette.sky(2 * half[0]), palette.wall(rng.uniform(1.0, 8.0))
    walls = [sky if rng.random() < 0.7 else palette.wall(rng.uniform(3.0, 15.0)) for _ in range(4)]
    faces = [walls[0], walls[1], sky, ground, walls[2], walls[3]]
    world = builder.build((np.array([0.0, -half[1], 0.0]), half), faces, sunlight(rng))
    eye_low, eye_high = np.array([-0.6, -0.25, -0.6]) * half, np.array([0.6 * half[0], -0.5, 0.6 * half[2]])
    look_low, look_high = np.array([-3.0, -2.0, -3.0]), np.array([3.0, 0.0, 3.0])
    return Stage(world, eye_low, eye_high, look_low, look_high, (2.0, 9.0))


def _floating(rng: np.random.Generator, palette: Palette, complexity: float) -> Stage:
    """Solids of all sorts anywhere in a room, for shapes that no furniture has."""
    builder = Builder()
    half = rng.uniform(1.2, 4.0, 3)
    centre = np.array([0.0, -half[1], 0.0])
    for _ in range(1 + _count(rng, complexity, 36)):
        floating(rng, builder, palette, centre - half, centre + half)
    if complexity > 0.5:
        table(rng, builder, palette, (0.0, 0.0, 0.0))
    faces = [palette.wall(2 * half[0]) for _ in range(6)]
    world = builder.build((centre, half), faces, indoor_lights(rng, half))
    low, high = centre - 0.85 * half, centre + 0.85 * half
    return Stage(world, low, high, low, high, (1.0, 6.0))


_LAYOUTS = (_room, _table_top, _open_ground, _floating)
_SHARES = (0.35, 0.3, 0.2, 0.15)
