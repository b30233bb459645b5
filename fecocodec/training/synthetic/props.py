"""Props: small objects, furniture, trees and houses, each of a few solids that stand on a floor or float."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.synthetic.materials import Palette
from fecocodec.training.synthetic.solids import (
    BOX,
    CONE,
    CYLINDER,
    ELLIPSOID,
    Builder,
    Material,
    random_rotation,
    yaw_rotation,
)

Triple = tuple[float, float, float]


class LocalFrame:
    """Frame of a prop at a point of a floor or table top: x right, y down, z back; heading in radians."""

    def __init__(self, builder: Builder, spot: Triple, heading: float) -> None:
        self._builder = builder
        self._spot = np.asarray(spot)
        self._rotation = yaw_rotation(heading)

    def add(self, kind: int, centre: Triple, half: Triple, material: Material) -> None:
        """Add an upright solid given in this frame."""
        self._builder.add(kind, self.at(centre), half, self._rotation, material)

    def at(self, centre: Triple) -> Triple:
        """Return the world position of a point of this frame."""
        x, y, z = self._spot + self._rotation @ np.asarray(centre)
        return float(x), float(y), float(z)


def clutter(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple, size: float) -> None:
    """Add one small prop of about this size in metres: a box, ball, can, bottle, figure or fallen block."""
    x, y, z = spot
    half = size * rng.uniform(0.3, 1.0, 3)
    material = palette.prop(2 * size)
    kind = rng.random()
    if kind < 0.3:
        rotation = yaw_rotation(rng.uniform(0.0, 6.3))
        builder.add(BOX, (x, y - half[1], z), tuple(half), rotation, material)
    elif kind < 0.5:
        builder.add(ELLIPSOID, (x, y - half[1], z), tuple(half), yaw_rotation(rng.uniform(0.0, 6.3)), material)
    elif kind < 0.7:
        builder.add(CYLINDER, (x, y - half[1], z), (half[0], half[1], half[0]), np.eye(3), material)
        if rng.random() < 0.4:
            neck = (0.4 * half[0], 0.4 * half[1], 0.4 * half[0])
            builder.add(CYLINDER, (x, y - 2 * half[1] - neck[1], z), neck, np.eye(3), material)
    elif kind < 0.85:
        _figure(rng, builder, palette, spot, size)
    else:
        builder.add(int(rng.integers(4)), (x, y - 0.6 * size, z), tuple(half), random_rotation(rng), material)


def _figure(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple, size: float) -> None:
    """Add a body with a head and limbs, like a toy or a statue."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    body, head = palette.prop(size), palette.prop(0.5 * size)
    frame.add(ELLIPSOID, (0.0, -0.8 * size, 0.0), (0.4 * size, 0.55 * size, 0.35 * size), body)
    frame.add(ELLIPSOID, (0.0, -1.55 * size, 0.0), (0.32 * size, 0.34 * size, 0.32 * size), head)
    for side in (-1, 1):
        frame.add(CYLINDER, (side * 0.2 * size, -0.2 * size, 0.0), (0.12 * size, 0.22 * size, 0.12 * size), body)
        frame.add(
            ELLIPSOID, (side * 0.45 * size, -0.9 * size, -0.15 * size), (0.1 * size, 0.35 * size, 0.1 * size), body
        )


def floating(
    rng: np.random.Generator, builder: Builder, palette: Palette, low: Float[ndarray, "3"], high: Float[ndarray, "3"]
) -> None:
    """Add a random solid at a random position between two corners, with a random rotation."""
    scale = 0.12 * float(np.linalg.norm(high - low)) * rng.uniform(0.15, 1.0)
    half = scale * rng.uniform(0.15, 1.0, 3)
    x, y, z = rng.uniform(low, high)
    builder.add(int(rng.integers(4)), (x, y, z), tuple(half), random_rotation(rng), palette.prop(2 * scale))


def table(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """A top on four legs or one foot, with clutter."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    half_x, half_z, height = rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.9)
    top, leg = palette.prop(2 * half_x), palette.prop(0.5)
    round_top = rng.random() < 0.25
    kind = CYLINDER if round_top else BOX
    frame.add(kind, (0.0, -height, 0.0), (half_x, 0.02, half_x if round_top else half_z), top)
    if round_top or rng.random() < 0.2:
        frame.add(CYLINDER, (0.0, -height / 2, 0.0), (0.05, height / 2, 0.05), leg)
    else:
        thick = rng.uniform(0.015, 0.04)
        for x in (-half_x + thick, half_x - thick):
            for z in (-half_z + thick, half_z - thick):
                frame.add(BOX, (x, -height / 2, z), (thick, height / 2, thick), leg)
    for _ in range(int(rng.integers(1, 5))):
        on_top = frame.at((rng.uniform(-0.7, 0.7) * half_x, -height - 0.02, rng.uniform(-0.7, 0.7) * half_z))
        clutter(rng, builder, palette, on_top, rng.uniform(0.06, 0.2))


def chair(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """Seat, back and legs, or an armchair of boxes."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    seat, leg, width = palette.prop(0.5), palette.prop(0.3), rng.uniform(0.2, 0.45)
    if rng.random() < 0.4:
        frame.add(BOX, (0.0, -0.22, 0.0), (width, 0.22, 0.4), seat)
        frame.add(BOX, (0.0, -0.45, 0.36), (width, 0.45, 0.1), seat)
        for side in (-1, 1):
            frame.add(BOX, (side * (width + 0.08), -0.3, 0.0), (0.08, 0.3, 0.42), seat)
        return
    frame.add(BOX, (0.0, -0.45, 0.0), (width, 0.025, 0.22), seat)
    frame.add(BOX, (0.0, -0.75, 0.21), (width, rng.uniform(0.1, 0.25), 0.02), seat)
    for x in (-width + 0.03, width - 0.03):
        frame.add(BOX, (x, -0.22, -0.19), (0.02, 0.22, 0.02), leg)
        frame.add(BOX, (x, -0.45, 0.2), (0.02, 0.45, 0.02), leg)


def shelf(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """Boards between two sides, with rows of books and boxes."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    width, height, boards = rng.uniform(0.3, 0.7), rng.uniform(0.8, 2.0), int(rng.integers(2, 5))
    wood = palette.prop(1.0)
    for side in (-1, 1):
        frame.add(BOX, (side * width, -height / 2, 0.0), (0.015, height / 2, 0.16), wood)
    if rng.random() < 0.7:
        frame.add(BOX, (0.0, -height / 2, 0.15), (width, height / 2, 0.01), wood)
    for board in range(boards):
        level = -0.05 - board * (height - 0.1) / max(boards - 1, 1)
        frame.add(BOX, (0.0, level, 0.0), (width, 0.015, 0.16), wood)
        left = -width + 0.05
        while left < width - 0.1 and rng.random() < 0.8 and board < boards - 1:
            thick, tall = rng.uniform(0.015, 0.12), rng.uniform(0.08, 0.14)
            frame.add(BOX, (left + thick, level - 0.015 - tall, 0.0), (thick, tall, 0.1), palette.prop(2 * tall))
            left += 2 * thick + rng.uniform(0.0, 0.15)


def cabinet(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """A large box with clutter on it."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    half = (rng.uniform(0.2, 0.8), rng.uniform(0.2, 1.0), rng.uniform(0.2, 0.4))
    frame.add(BOX, (0.0, -half[1], 0.0), half, palette.prop(2 * half[0]))
    frame.add(BOX, (0.0, -half[1], -half[2]), (half[0] * 0.9, half[1] * 0.9, 0.01), palette.picture((half[0], half[1])))
    for _ in range(int(rng.integers(0, 3))):
        clutter(rng, builder, palette, frame.at((rng.uniform(-0.7, 0.7) * half[0], -2 * half[1], 0.0)), 0.15)


def lamp(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """Foot, pole and shade."""
    frame = LocalFrame(builder, spot, 0.0)
    height, metal = rng.uniform(0.5, 1.8), palette.prop(0.3)
    frame.add(CYLINDER, (0.0, -0.015, 0.0), (0.15, 0.015, 0.15), metal)
    frame.add(CYLINDER, (0.0, -height / 2, 0.0), (0.015, height / 2, 0.015), metal)
    shade = palette.lamp() if rng.random() < 0.4 else palette.prop(0.4)
    frame.add(CONE if rng.random() < 0.6 else CYLINDER, (0.0, -height, 0.0), (0.2, 0.14, 0.2), shade)


def pile(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """Boxes stacked on each other, each at its own angle."""
    x, y, z = spot
    size = rng.uniform(0.15, 0.5)
    for _ in range(int(rng.integers(1, 5))):
        half = (size * rng.uniform(0.6, 1.2), size * rng.uniform(0.2, 0.8), size * rng.uniform(0.6, 1.2))
        builder.add(BOX, (x, y - half[1], z), half, yaw_rotation(rng.uniform(0.0, 6.3)), palette.prop(2 * half[0]))
        y, size = y - 2 * half[1], size * rng.uniform(0.6, 0.95)


def tree(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """A trunk with a crown of ellipsoids or cones."""
    x, y, z = spot
    height, wide = rng.uniform(0.6, 3.0), rng.uniform(0.2, 0.5)
    bark, leaves = palette.prop(0.4), palette.prop(0.8)
    builder.add(CYLINDER, (x, y - height / 2, z), (0.06 * height, height / 2, 0.06 * height), np.eye(3), bark)
    if rng.random() < 0.4:
        for layer in range(3):
            size = height * wide * (1 - 0.25 * layer)
            top = y - height * (0.7 + 0.35 * layer)
            builder.add(CONE, (x, top, z), (size, 0.35 * height, size), np.eye(3), leaves)
        return
    for _ in range(int(rng.integers(2, 7))):
        dx, dy, dz = rng.normal(0.0, 0.25, 3) * height
        half = tuple(height * wide * rng.uniform(0.5, 1.0, 3))
        builder.add(ELLIPSOID, (x + dx, y - height + dy, z + dz), half, random_rotation(rng), leaves)


def house(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple) -> None:
    """A block with rows of windows, a door, perhaps a roof."""
    frame = LocalFrame(builder, spot, rng.uniform(0.0, 6.3))
    half = (rng.uniform(1.0, 4.0), rng.uniform(1.0, 4.0), rng.uniform(1.0, 4.0))
    frame.add(BOX, (0.0, -half[1], 0.0), half, palette.wall(2 * half[0]))
    window, door = palette.prop(0.8), palette.prop(1.0)
    step = rng.uniform(0.9, 1.8)
    for x in np.arange(-half[0] + 0.5, half[0] - 0.3, step)[:4]:
        for y in np.arange(1.2, 2 * half[1] - 0.3, 1.5 * step)[:3]:
            frame.add(BOX, (float(x), -float(y), -half[2]), (0.28, 0.4, rng.uniform(0.01, 0.1)), window)
    frame.add(BOX, (rng.uniform(-0.5, 0.5) * half[0], -0.8, -half[2]), (0.4, 0.8, 0.08), door)
    if rng.random() < 0.5:
        cover = palette.prop(half[0])
        frame.add(CONE, (0.0, -2 * half[1] - 0.5, 0.0), (1.5 * half[0], 0.5 * half[1], 1.5 * half[2]), cover)


Prop = Callable[[np.random.Generator, Builder, Palette, Triple], None]
INDOOR_PROPS: tuple[Prop, ...] = (table, table, chair, chair, shelf, cabinet, lamp, pile, pile)
OUTDOOR_PROPS: tuple[Prop, ...] = (tree, tree, house, pile, chair, cabinet, house)
