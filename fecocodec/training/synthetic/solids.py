"""Contents of a synthetic world: a room, convex solids, their surfaces and two lights.

The compiled ray caster takes them as tables of numbers, one row per solid and one per surface.
"""

from dataclasses import astuple, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial.transform import Rotation

BOX, ELLIPSOID, CYLINDER, CONE = range(4)
"""Kinds of solid. Each fills the local cube [-1, 1]^3; cylinders and cones stand along y, the apex is up (-y)."""

NUM_ROOM_FACES = 6
"""Surfaces 0..5 belong to the room, in the order -x +x -y +y -z +z; surface 6 + i belongs to solid i."""


@dataclass(frozen=True)
class Material:
    """Appearance of a surface. Colours are linear light.

    texture: index into the textures. texture_share: 0 for the plain colour, 1 for the texture alone.
    texture_scale: repeats of the texture per metre, horizontally and vertically.
    gloss: strength of the highlight. shininess: its exponent. glow: share of the colour that is emitted.
    """

    texture: int
    texture_share: float
    texture_scale: tuple[float, float]
    texture_offset: tuple[float, float]
    tint: tuple[float, float, float]
    plain: tuple[float, float, float]
    gloss: float = 0.0
    shininess: float = 20.0
    glow: float = 0.0


@dataclass(frozen=True)
class Lights:
    """A key light that casts shadows, a fill light that does not, and ambient light.

    key, fill: positions in metres (far away for the sun). *_colour: linear light that reaches a surface facing them.
    softness: width of penumbras as a fraction of the distance to the caster.
    """

    key: Float[ndarray, "3"]
    key_colour: Float[ndarray, "3"]
    fill: Float[ndarray, "3"]
    fill_colour: Float[ndarray, "3"]
    ambient: Float[ndarray, "3"]
    softness: float


@dataclass(frozen=True)
class World:
    """A world in metres, y down, seen from inside the axis-aligned room."""

    room_centre: Float[ndarray, "3"]
    room_half: Float[ndarray, "3"]
    kinds: Int[ndarray, "solid"]
    centres: Float[ndarray, "solid 3"]
    halves: Float[ndarray, "solid 3"]
    rotations: Float[ndarray, "solid 3 3"]
    surfaces: tuple[Material, ...]
    lights: Lights


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


@dataclass
class Builder:
    """Collects the solids of a world."""

    solids: list[tuple[Any, ...]] = field(default_factory=list)

    def add(
        self,
        kind: int,
        centre: tuple[float, float, float],
        half: tuple[float, float, float],
        rotation: Float[ndarray, "3 3"],
        material: Material,
    ) -> None:
        """Add one solid: its centre, half sizes along its own axes, and local-to-world rotation."""
        self.solids.append((kind, centre, half, rotation, material))

    def build(self, room: tuple[ndarray, ndarray], faces: list[Material], lights: Lights) -> World:
        """Return the world. room: its centre and half size in metres. faces: the six materials of the room."""
        kinds, centres, halves, rotations, materials = zip(*self.solids, strict=True) if self.solids else ((),) * 5
        return World(
            room_centre=np.asarray(room[0], dtype=np.float64),
            room_half=np.asarray(room[1], dtype=np.float64),
            kinds=np.array(kinds, dtype=np.int64),
            centres=np.array(centres, dtype=np.float64).reshape(-1, 3),
            halves=np.array(halves, dtype=np.float64).reshape(-1, 3),
            rotations=np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
            surfaces=(*faces, *materials),
            lights=lights,
        )


def yaw_rotation(angle: float) -> Float[ndarray, "3 3"]:
    """Return the rotation about the vertical axis by an angle in radians."""
    return Rotation.from_euler("y", angle).as_matrix()


def random_rotation(rng: np.random.Generator) -> Float[ndarray, "3 3"]:
    """Draw a uniformly distributed rotation (from a normalised random quaternion)."""
    w, x, y, z = rng.standard_normal(4)
    return Rotation.from_quat((x, y, z, w)).as_matrix()


KIND, CENTRE, HALF, FRAME, RADIUS, AREA = 0, 1, 4, 7, 16, 17
"""Columns of a solid: kind, centre (3), half sizes (3), world-to-unit-coordinates matrix (9, by rows), radius of the
bounding sphere, and the mean square of the half sizes, for ambient occlusion."""

TEXTURE, SHARE, SCALE, OFFSET, TINT, PLAIN, GLOSS, SHININESS, GLOW = 0, 1, 2, 4, 6, 9, 12, 13, 14
"""Columns of a surface, in the order of `Material`: texture, share, scale (2), offset (2), tint (3), plain (3), ..."""

KEY, KEY_COLOUR, FILL, FILL_COLOUR, AMBIENT, SOFTNESS = range(6)
"""Rows of the lights, as in `Lights`; softness is repeated three times."""


def solid_table(world: World) -> Float[ndarray, "solid 18"]:
    """Return one row per solid, columns as above."""
    to_unit = world.rotations.transpose(0, 2, 1) / world.halves[:, :, None]
    corner_radii = np.linalg.norm(world.halves, axis=-1)
    radii = np.where(world.kinds == ELLIPSOID, world.halves.max(-1, initial=0.0), corner_radii)
    areas = world.halves.prod(-1) ** (2 / 3)
    columns = (
        world.kinds[:, None],
        world.centres,
        world.halves,
        to_unit.reshape(-1, 9),
        radii[:, None],
        areas[:, None],
    )
    return np.ascontiguousarray(np.concatenate(columns, axis=1), dtype=np.float64)


def surface_table(surfaces: tuple[Material, ...]) -> Float[ndarray, "surface 15"]:
    """Return one row per surface, columns as above."""
    return np.array([np.hstack(astuple(surface)) for surface in surfaces], dtype=np.float64)


def light_table(lights: Lights) -> Float[ndarray, "6 3"]:
    """Return one row per quantity, rows as above."""
    softness = np.full(3, lights.softness)
    rows = (lights.key, lights.key_colour, lights.fill, lights.fill_colour, lights.ambient, softness)
    return np.stack(rows).astype(np.float64)
