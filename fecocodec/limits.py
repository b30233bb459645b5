"""Limits of the codec: numbers of views and stages, image sides."""

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
SIDE_MULTIPLE = 32  # pixels; the networks halve a side five times
MAX_STAGES = 2
MAX_SH_DEGREE = 1
DEFAULT_MAX_PIXELS = 1 << 22  # pixels of all views that `decode` accepts by default


def grid_side(side: int) -> int:
    """Return the side of the coding grid in pixels: the multiple of 32 nearest to the side of a view, ties upwards."""
    return (side + SIDE_MULTIPLE // 2) // SIDE_MULTIPLE * SIDE_MULTIPLE
