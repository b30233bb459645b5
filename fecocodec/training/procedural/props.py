"""Small things, and the spot that a thing made of several solids stands on."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.materials import Palette
from fecocodec.training.procedural.solids import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    Builder,
    Material,
    random_rotation,
    yaw_rotation,
)

Triple = tuple[float, float, float]


class Place:
    """A spot on a floor or a table top with a heading; adds solids given in its own frame (x right, y down, z back)."""

    def __init__(self, builder: Builder, spot: Triple, heading: float) -> None:
        self._builder = builder
        self._spot = np.asarray(spot)
        self._rotation = yaw_rotation(heading)

    def add(self, kind: int, centre: Triple, half: Triple, material: Material, turn: float = 0.0) -> None:
        """A solid that stands upright, turned about the vertical by turn radians against the place."""
        x, y, z = self._spot + self._rotation @ np.asarray(centre)
        rotation = self._rotation @ yaw_rotation(turn) if turn else self._rotation
        self._builder.add(kind, (float(x), float(y), float(z)), half, rotation, material)

    def at(self, centre: Triple) -> Triple:
        """World position of a point of the place."""
        x, y, z = self._spot + self._rotation @ np.asarray(centre)
        return float(x), float(y), float(z)


def clutter(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple, size: float) -> None:
    """One small thing of about that size in metres: a box, ball, can, bottle, bowl, figure or fallen block."""
    x, y, z = spot
    half = size * rng.uniform(0.3, 1.0, 3)
    material = palette.thing(2 * size)
    sort = rng.random()
    if sort < 0.3:
        rotation = yaw_rotation(rng.uniform(0.0, 6.3))
        builder.add(BOX, (x, y - half[1], z), tuple(half), rotation, material)
    elif sort < 0.5:
        builder.add(ELLIPSOID, (x, y - half[1], z), tuple(half), yaw_rotation(rng.uniform(0.0, 6.3)), material)
    elif sort < 0.7:
        builder.add(CYLINDER, (x, y - half[1], z), (half[0], half[1], half[0]), np.eye(3), material)
        if rng.random() < 0.4:
            neck = (0.4 * half[0], 0.4 * half[1], 0.4 * half[0])
            builder.add(CYLINDER, (x, y - 2 * half[1] - neck[1], z), neck, np.eye(3), material)
    elif sort < 0.85:
        _figure(rng, builder, palette, spot, size)
    else:
        builder.add(int(rng.integers(4)), (x, y - 0.6 * size, z), tuple(half), random_rotation(rng), material)


def _figure(rng: np.random.Generator, builder: Builder, palette: Palette, spot: Triple, size: float) -> None:
    """A body with a head and limbs, as of a toy or a statue."""
    place = Place(builder, spot, rng.uniform(0.0, 6.3))
    body, head = palette.thing(size), palette.thing(0.5 * size)
    place.add(ELLIPSOID, (0.0, -0.8 * size, 0.0), (0.4 * size, 0.55 * size, 0.35 * size), body)
    place.add(ELLIPSOID, (0.0, -1.55 * size, 0.0), (0.32 * size, 0.34 * size, 0.32 * size), head)
    for side in (-1, 1):
        place.add(CYLINDER, (side * 0.2 * size, -0.2 * size, 0.0), (0.12 * size, 0.22 * size, 0.12 * size), body)
        place.add(
            ELLIPSOID, (side * 0.45 * size, -0.9 * size, -0.15 * size), (0.1 * size, 0.35 * size, 0.1 * size), body
        )


def floating(
    rng: np.random.Generator, builder: Builder, palette: Palette, low: Float[ndarray, "3"], high: Float[ndarray, "3"]
) -> None:
    """Any solid, anywhere between two corners, any way up."""
    scale = 0.12 * float(np.linalg.norm(high - low)) * rng.uniform(0.15, 1.0)
    half = scale * rng.uniform(0.15, 1.0, 3)
    x, y, z = rng.uniform(low, high)
    builder.add(int(rng.integers(4)), (x, y, z), tuple(half), random_rotation(rng), palette.thing(2 * scale))
