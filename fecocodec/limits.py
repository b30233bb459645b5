"""What the codec accepts: views, sides of images, stages."""

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
SIDE_MULTIPLE = 32  # pixels; the networks halve a side five times
MAX_STAGES = 2
DEFAULT_MAX_PIXELS = 1 << 22  # of all views; `decode` refuses more unless it is asked for


def grid_side(side: int) -> int:
    """Return the side of the coding grid: the multiple of 32 nearest to the side of the views, half way upwards."""
    return (side + SIDE_MULTIPLE // 2) // SIDE_MULTIPLE * SIDE_MULTIPLE
