"""Random materials and lights."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.training.synthetic.solids import Lights, Material

Colour = tuple[float, float, float]


class Palette:
    """Draws materials. A world reuses some of them, so that its props look related."""

    def __init__(self, rng: np.random.Generator, num_textures: int) -> None:
        self._rng = rng
        self._num_textures = num_textures
        self._kept = [self._new_prop(1.0) for _ in range(int(rng.integers(2, 6)))]

    def prop(self, extent: float) -> Material:
        """Return the material of a prop about `extent` metres wide; one in four is reused."""
        if self._rng.random() < 0.25:
            return self._kept[int(self._rng.integers(len(self._kept)))]
        return self._new_prop(extent)

    def wall(self, extent: float) -> Material:
        """Return the material of a wall, floor or ceiling `extent` metres wide: textured or painted."""
        rng = self._rng
        painted = rng.random() < 0.3
        light = rng.uniform(0.3, 0.9) + rng.uniform(-0.08, 0.08, 3)
        share = rng.uniform(0, 0.3) if painted else rng.uniform(0.6, 1.0)
        return self._textured(share, rng.uniform(1.5, 9.0) / extent, light, gloss=rng.uniform(0, 0.1))

    def picture(self, half: tuple[float, float]) -> Material:
        """Return the material of a flat box in its own x-y plane: one texture stretched over it."""
        texture = int(self._rng.integers(self._num_textures))
        scale = (0.5 / half[0], 0.5 / half[1])
        return Material(texture, 1.0, scale, (0.5, 0.5), self._tint(0.1), (0.5, 0.5, 0.5))

    def lamp(self) -> Material:
        """Return the material of a light source."""
        warm = self._rng.uniform(0.6, 1.0)
        return Material(0, 0.0, (1.0, 1.0), (0.0, 0.0), (1.0, 1.0, 1.0), (1.5, 1.5 * warm, 1.5 * warm * warm), glow=1.0)

    def sky(self, extent: float) -> Material:
        """Return the material of a backdrop that needs no light, from plain to cloudy."""
        rng = self._rng
        blue = rng.uniform(0.7, 1.4) * np.array([rng.uniform(0.4, 0.9), rng.uniform(0.6, 0.95), 1.0])
        texture = int(rng.integers(self._num_textures))
        scale = rng.uniform(0.5, 2.0) / extent
        share = rng.uniform(0.0, 0.5)
        return Material(texture, share, (scale, scale), (0.3, 0.5), self._tint(0.2), _colour(blue), glow=1.0)

    def _new_prop(self, extent: float) -> Material:
        rng = self._rng
        share = rng.uniform(0.0, 0.2) if rng.random() < 0.2 else rng.uniform(0.75, 1.0)
        plain = rng.uniform(0.02, 0.9, 3) ** 1.5
        gloss = rng.uniform(0.1, 0.9) if rng.random() < 0.3 else 0.0
        return self._textured(share, rng.uniform(0.5, 4.0) / extent, plain, gloss)

    def _textured(self, share: float, scale: float, plain: Float[ndarray, "3"], gloss: float) -> Material:
        rng = self._rng
        offset = (float(rng.random()), float(rng.random()))
        texture, shininess = int(rng.integers(self._num_textures)), float(rng.uniform(5, 60))
        colour = _colour(np.clip(plain, 0.01, 1))
        return Material(texture, share, (scale, scale), offset, self._tint(0.6), colour, float(gloss), shininess)

    def _tint(self, spread: float) -> Colour:
        brightness = self._rng.uniform(-spread, spread)
        return _colour(np.exp(brightness + self._rng.uniform(-spread, spread, 3) * 0.5))


def _colour(values: Float[ndarray, "3"]) -> Colour:
    return float(values[0]), float(values[1]), float(values[2])


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
