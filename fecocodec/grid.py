"""The grids of the codec: how many pixels of the coding grid a position of each has along a side. No torch."""

GAUSSIANS = 2  # one Gaussian per 2x2 pixels by default
FEATURES = 4  # features and states: F, S0..S2; a position is a cell
LATENTS = 8  # y, and the coefficients of detail; a position is a block
FADING = 16  # levels of fading
HYPERLATENTS = 32  # z, the coarsest: sides of the coding grid are multiples of it

PER_CELL = FEATURES // GAUSSIANS  # Gaussians along a side of a cell
PER_BLOCK = LATENTS // GAUSSIANS  # Gaussians along a side of a block
LATENTS_PER_HYPERLATENT = HYPERLATENTS // LATENTS
VALUES_PER_CELL = FEATURES**2 * 3  # colours of the pixels of a cell, as channels


def grid_side(side: int) -> int:
    """Return the side of the coding grid in pixels: the multiple of 32 nearest to the side of a view, ties upwards."""
    return (side + HYPERLATENTS // 2) // HYPERLATENTS * HYPERLATENTS
