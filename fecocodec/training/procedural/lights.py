"""Random lights of rooms and of open ground."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.procedural.solids import Lights


def indoor_lights(rng: np.random.Generator, half: Float[ndarray, "3"]) -> Lights:
    """Draw a lamp under the ceiling, or a distant light as through a window."""
    if rng.random() < 0.6:
        key = rng.uniform(-0.8, 0.8, 3) * half
        key[1] = -2 * half[1] * rng.uniform(0.85, 0.99)
    else:
        return sunlight(rng)
    fill = np.array([rng.uniform(-1, 1) * half[0], -rng.uniform(0.5, 1.9) * half[1], rng.uniform(-1, 1) * half[2]])
    return _lights(rng, key, fill)


def sunlight(rng: np.random.Generator) -> Lights:
    """Draw a distant key light above the horizon."""
    angle, height = rng.uniform(0, 6.3), rng.uniform(0.35, 1.5)
    key = 1e3 * np.array([np.cos(height) * np.cos(angle), -np.sin(height), np.cos(height) * np.sin(angle)])
    fill = 1e3 * np.array([rng.uniform(-1, 1), -1.0, rng.uniform(-1, 1)])
    return _lights(rng, key, fill)


def _lights(rng: np.random.Generator, key: Float[ndarray, "3"], fill: Float[ndarray, "3"]) -> Lights:
    tint = rng.uniform(0.8, 1.0, (3, 3))
    return Lights(
        key=key,
        key_colour=tint[0] * rng.uniform(0.5, 1.8),
        fill=fill,
        fill_colour=tint[1] * rng.uniform(0.05, 0.4),
        ambient=tint[2] * rng.uniform(0.12, 0.45),
        softness=float(np.exp(rng.uniform(np.log(0.02), np.log(0.6)))),
    )
