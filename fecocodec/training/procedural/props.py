"""Small props, and the local frame of a prop made of several solids."""

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


class LocalFrame:
    """Frame of a prop at a point of a floor or table top: x right, y down, z back; heading in radians."""

    def __init__(self, builder: Builder, spot: Triple, heading: float) -> None:
        self._builder = builder
        self._spot = np.asarray(spot)
        self._rotation = yaw_rotation(heading)

    def add(self, kind: int, centre: Triple, half: Triple, material: Material, turn: float = 0.0) -> None:
        """Add an upright solid given in this frame, turned about the vertical by `turn` radians."""
        x, y, z = self._spot + self._rotation @ np.asarray(centre)
        rotation = self._rotation @ yaw_rotation(turn) if turn else self._rotation
        self._builder.add(kind, (float(x), float(y), float(z)), half, rotation, material)

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
