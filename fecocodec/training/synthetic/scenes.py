"""Synthetic scenes: photo-like views of random worlds with exact cameras and depth.

Worlds are rooms, table tops, open ground and floating solids, from bare to crowded.
"""

from dataclasses import dataclass, field

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float
from numpy import ndarray

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.training.samples import Sample
from fecocodec.training.synthetic.cameras import PathRange, place_cameras
from fecocodec.training.synthetic.images import Pinholes, cast_images
from fecocodec.training.synthetic.materials import Palette, indoor_lights, sunlight
from fecocodec.training.synthetic.props import INDOOR_PROPS, OUTDOOR_PROPS, clutter, floating, table
from fecocodec.training.synthetic.solids import BOX, Builder, Stage, random_rotation, yaw_rotation
from fecocodec.training.synthetic.textures import Textures


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


@dataclass(frozen=True)
class SyntheticScenes:
    """Draws a new random world for every sample.

    textures: of its surfaces. complexity: range, from 0 (bare walls) to 1 (crowded). path: distribution of cameras.
    decades: the unit of length is log-uniform over this many decades around the metre.
    """

    textures: Textures
    complexity: tuple[float, float] = (0.1, 1.0)
    path: PathRange = field(default_factory=PathRange)
    decades: float = 4.0

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw one scene with exact depth; size: (height, width) in pixels. Equal states give equal samples."""
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        complexity = float(rng.uniform(*self.complexity))
        unit = 10 ** float(rng.uniform(-self.decades / 2, self.decades / 2))
        stage = lay_out(rng, len(self.textures), complexity)
        pinholes = place_cameras(rng, stage, self.path, num_context, num_target, size)
        light, depth = cast_images(stage.world, self.textures, pinholes)
        images = _develop(rng, light)
        names = tuple(f"view {view}" for view in range(len(images)))
        cameras = _cameras(rng, pinholes, depth, unit)
        views = Views(torch.from_numpy(rearrange(images, "v h w rgb -> v rgb h w").copy()), cameras, names)
        return Sample(views, num_context, torch.from_numpy(depth * np.float32(unit)))


def _develop(
    rng: np.random.Generator, light: Float[ndarray, "view height width 3"]
) -> Float[ndarray, "view height width 3"]:
    """Convert linear light to sRGB-like photographs: one exposure and white balance, a tone curve, sensor noise."""
    exposure = rng.uniform(0.1, 0.35) / max(float(light.mean()), 1e-3)
    balance = np.exp(rng.normal(0, 0.12, 3)) * exposure
    noise_level = rng.uniform(0.0, 0.015)
    per_view = np.exp(rng.normal(0, 0.02, (len(light), 1, 1, 1)))
    exposed = light * (balance * per_view).astype(np.float32)
    # A shoulder keeps detail in highlights, as in cameras: linear up to 0.7, then approaching 1.
    bent = np.where(exposed > 0.7, 1 - 0.3 * np.exp((0.7 - exposed) / 0.3), exposed)
    contrast = rng.uniform(0.0, 0.6)
    toned = np.sqrt(bent)
    toned += contrast * toned * (1 - toned) * (2 * toned - 1)
    noise = rng.standard_normal(light.shape, dtype=np.float32) * np.float32(noise_level)
    developed: ndarray = np.clip(toned + noise, 0, 1).astype(np.float32)
    return developed


def _cameras(
    rng: np.random.Generator, pinholes: Pinholes, depth: Float[ndarray, "view height width"], unit: float
) -> Cameras:
    """Return cameras in a random world frame and unit of length; near and far are widened quantiles of depth."""
    height, width = pinholes.size
    turn = random_rotation(rng)
    extrinsics = np.tile(np.eye(4), (len(pinholes.eyes), 1, 1))
    extrinsics[:, :3, :3] = turn @ pinholes.rotations
    extrinsics[:, :3, 3] = (pinholes.eyes - pinholes.eyes.mean(0)) @ turn.T * unit
    intrinsics = np.array(
        [
            [pinholes.focal / width, 0.0, pinholes.centre[0] / width],
            [0.0, pinholes.focal / height, pinholes.centre[1] / height],
            [0.0, 0.0, 1.0],
        ]
    )
    near, far = np.quantile(depth, (0.01, 0.99)) * unit
    return Cameras.in_float32(extrinsics, np.tile(intrinsics, (len(extrinsics), 1, 1)), near / 1.15, far * 1.15)
