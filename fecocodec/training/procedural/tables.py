"""A world as tables of numbers for the compiled ray caster: one row per solid, one row per surface."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.solids import ELLIPSOID, Lights, Material, World

KIND, CENTRE, HALF, FRAME, RADIUS, AREA = 0, 1, 4, 7, 16, 17
"""Columns of a solid: kind, centre (3), half sizes (3), world-to-unit-coordinates matrix (9, by rows), radius of the
bounding sphere, and the mean square of the half sizes, for ambient occlusion."""

TEXTURE, SCALE, OFFSET, SHARE, TINT, PLAIN, GLOSS, SHININESS, GLOW = 0, 1, 3, 5, 6, 9, 12, 13, 14
"""Columns of a surface, as in `Material`: texture, scale (2), offset (2), share, tint (3), plain (3), ..."""

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
    return np.array([_surface_row(surface) for surface in surfaces], dtype=np.float64)


def light_table(lights: Lights) -> Float[ndarray, "6 3"]:
    """Return one row per quantity, rows as above."""
    softness = np.full(3, lights.softness)
    rows = (lights.key, lights.key_colour, lights.fill, lights.fill_colour, lights.ambient, softness)
    return np.stack(rows).astype(np.float64)


def _surface_row(surface: Material) -> list[float]:
    return [
        float(surface.texture),
        *surface.texture_scale,
        *surface.texture_offset,
        surface.texture_share,
        *surface.tint,
        *surface.plain,
        surface.gloss,
        surface.shininess,
        surface.glow,
    ]
