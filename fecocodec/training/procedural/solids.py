"""Contents of a procedural world as arrays: a room, convex solids, their surfaces and two lights."""

from dataclasses import dataclass, field

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


@dataclass
class Builder:
    """Collects the solids of a world."""

    kinds: list[int] = field(default_factory=list)
    centres: list[tuple[float, float, float]] = field(default_factory=list)
    halves: list[tuple[float, float, float]] = field(default_factory=list)
    rotations: list[ndarray] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)

    def add(
        self,
        kind: int,
        centre: tuple[float, float, float],
        half: tuple[float, float, float],
        rotation: Float[ndarray, "3 3"],
        material: Material,
    ) -> None:
        """Add one solid: its centre, half sizes along its own axes, and local-to-world rotation."""
        self.kinds.append(kind)
        self.centres.append(centre)
        self.halves.append(half)
        self.rotations.append(rotation)
        self.materials.append(material)

    def build(self, room: tuple[ndarray, ndarray], faces: list[Material], lights: Lights) -> World:
        """Return the world. room: its centre and half size in metres. faces: the six materials of the room."""
        return World(
            room_centre=np.asarray(room[0], dtype=np.float64),
            room_half=np.asarray(room[1], dtype=np.float64),
            kinds=np.array(self.kinds, dtype=np.int64),
            centres=np.array(self.centres, dtype=np.float64).reshape(-1, 3),
            halves=np.array(self.halves, dtype=np.float64).reshape(-1, 3),
            rotations=np.array(self.rotations, dtype=np.float64).reshape(-1, 3, 3),
            surfaces=(*faces, *self.materials),
            lights=lights,
        )


def yaw_rotation(angle: float) -> Float[ndarray, "3 3"]:
    """Return the rotation about the vertical axis by an angle in radians."""
    return Rotation.from_euler("y", angle).as_matrix()


def random_rotation(rng: np.random.Generator) -> Float[ndarray, "3 3"]:
    """Draw a uniformly distributed rotation (from a normalised random quaternion)."""
    w, x, y, z = rng.standard_normal(4)
    return Rotation.from_quat((x, y, z, w)).as_matrix()
