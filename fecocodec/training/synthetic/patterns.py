"""Random textures: noise, stripes, checks, bricks, boards, dots, marble, cloth, writing and collages."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

Pattern = Callable[[np.random.Generator, int], ndarray]


def draw_patterns(rng: np.random.Generator, num_patterns: int, side: int) -> UInt8[ndarray, "pattern side side 3"]:
    """Draw random patterns of every kind, in sRGB; all of them tile."""
    images = np.empty((num_patterns, side, side, 3), dtype=np.uint8)
    for index in range(num_patterns):
        weight = _PATTERNS[index % len(_PATTERNS)](rng, side)
        images[index] = _colour(weight, rng, side)
    return images


def _colour(weight: Float[ndarray, "side side"], rng: np.random.Generator, side: int) -> UInt8[ndarray, "side side 3"]:
    """Blend two colours by the pattern, add a third by noise, then grain."""
    first, second, third = rng.uniform(0.03, 0.97, (3, 3)) * 0.75 + rng.uniform(0.03, 0.97, (3, 1)) * 0.25
    if rng.random() < 0.3:
        second = first + (second - first) * rng.uniform(0.15, 0.6)
    image = first + (second - first) * weight[..., None]
    cloud = _noise(rng, side, 2, 5)[..., None] * rng.uniform(0, 0.5)
    image = image + (third - image) * cloud
    grain = (_noise(rng, side, 16, 4) - 0.5)[..., None] * rng.uniform(0, 0.35)
    return np.clip((image + grain) * 255, 0, 255).astype(np.uint8)


def _noise(rng: np.random.Generator, side: int, cells: int, octaves: int) -> Float[ndarray, "side side"]:
    """Tiling value noise in [0, 1]; each octave has twice the cells and 0.6 of the strength."""
    total = np.zeros((side, side))
    strength, strengths = 1.0, 0.0
    for _ in range(octaves):
        if cells > side:
            break
        total += strength * _stretched(rng.random((cells, cells)), side)
        strengths += strength
        cells, strength = cells * 2, strength * 0.6
    return np.clip((total / strengths - 0.5) * 1.8 + 0.5, 0, 1)


def _stretched(grid: Float[ndarray, "cells cells"], side: int) -> Float[ndarray, "side side"]:
    """Smooth periodic interpolation of a small grid."""
    cells = len(grid)
    position = np.arange(side) * cells / side
    low = position.astype(int)
    share = position - low
    share = share * share * (3 - 2 * share)
    high = (low + 1) % cells
    rows = grid[low] * (1 - share)[:, None] + grid[high] * share[:, None]
    columns: ndarray = rows[:, low] * (1 - share) + rows[:, high] * share
    return columns


def _grid(side: int) -> tuple[Float[ndarray, "side side"], Float[ndarray, "side side"]]:
    """Row and column positions in [0, 1)."""
    row, column = np.meshgrid(np.arange(side) / side, np.arange(side) / side, indexing="ij")
    return row, column


def _clouds(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    return _noise(rng, side, int(rng.integers(2, 9)), 5)


def _grain(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    return _noise(rng, side, side // 4, 3)


def _stripes(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    row, column = _grid(side)
    phase = row * rng.integers(-3, 4) + column * rng.integers(2, 14)
    return (np.mod(phase, 1) < rng.uniform(0.2, 0.8)).astype(float)


def _checks(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    row, column = _grid(side)
    cells = 2 * int(rng.integers(1, 7))
    return ((row * cells).astype(int) + (column * cells).astype(int)) % 2 * 1.0


def _bricks(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    row, column = _grid(side)
    courses, bricks, joint = 2 * int(rng.integers(2, 6)), int(rng.integers(2, 5)), rng.uniform(0.04, 0.12)
    course = (row * courses).astype(int)
    along = column * bricks + (course % 2) * 0.5 * rng.integers(0, 2)
    shade = rng.uniform(0.4, 1, (courses, bricks))[course, along.astype(int) % bricks]
    inside = (np.mod(row * courses, 1) > joint) & (np.mod(along, 1) > joint * bricks / courses)
    return np.where(inside, shade, 0.0)


def _boards(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    _, column = _grid(side)
    boards = int(rng.integers(1, 7))
    board = (column * boards).astype(int)
    bend = _noise(rng, side, 3, 3) * rng.uniform(0.05, 0.3)
    rings = np.sin(2 * np.pi * (column * 8 + bend * 8 + rng.random(boards)[board] * 5)) * 0.25 + 0.5
    fine = _stretched(rng.random((side // 2, side // 2)), side)
    gaps = np.mod(column * boards, 1) > 0.03
    return (rings + 0.3 * fine * rng.random(boards)[board]) * gaps


def _dots(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    row, column = _grid(side)
    cells = int(rng.integers(2, 9))
    distance = np.hypot(np.mod(row * cells, 1) - 0.5, np.mod(column * cells, 1) - 0.5)
    return np.clip((rng.uniform(0.15, 0.45) - distance) * side / cells, 0, 1)


def _marble(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    row, column = _grid(side)
    turbulence = _noise(rng, side, 3, 5) * rng.uniform(1, 4)
    wave = np.sin(2 * np.pi * (row * rng.integers(0, 3) + column * rng.integers(1, 4) + turbulence))
    return np.abs(wave) ** rng.uniform(0.3, 1.0)


def _cloth(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    bands = rng.random(8)[np.arange(side) * 8 // side]
    weave = (np.arange(side)[:, None] // 2 + np.arange(side)[None] // 2) % 2
    return np.where(weave == 1, bands[:, None], bands[None])


def _writing(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    """Lines of small random glyphs, as on a page, a poster or a label."""
    page = np.zeros((side, side))
    glyph = int(rng.integers(4, 13))
    for top in range(2, side - glyph, int(glyph * 1.5)):
        left = 2
        line_end = side - int(rng.integers(0, side // 2))
        while left < line_end - glyph:
            if rng.random() < 0.85:
                page[top : top + glyph, left : left + glyph - 1] = _glyph(rng, glyph)[:, : glyph - 1]
            left += glyph
    return page


def _glyph(rng: np.random.Generator, size: int) -> Float[ndarray, "size size"]:
    """A few strokes."""
    image = np.zeros((size, size))
    stroke = max(1, size // 5)
    for _ in range(3):
        at = int(rng.integers(0, size - stroke))
        if rng.random() < 0.5:
            image[at : at + stroke] = 1
        else:
            image[:, at : at + stroke] = 1
    return image * (rng.random((size, size)) < 0.97)


def _collage(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    """Overlapping rectangles and discs, as in a picture."""
    image = _noise(rng, side, 2, 3)
    row, column = _grid(side)
    for _ in range(int(rng.integers(4, 16))):
        centre, size = rng.random(2), rng.uniform(0.04, 0.3, 2)
        offset = (row - centre[0]) / size[0], (column - centre[1]) / size[1]
        disc = rng.random() < 0.5
        inside = np.hypot(*offset) < 1 if disc else np.maximum(np.abs(offset[0]), np.abs(offset[1])) < 1
        image = np.where(inside, rng.random(), image)
    return image


_PATTERNS: tuple[Pattern, ...] = (
    _clouds, _bricks, _writing, _boards, _collage, _grain, _stripes,
    _marble, _collage, _checks, _cloth, _clouds, _dots,
)  # fmt: skip
