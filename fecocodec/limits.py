"""Limits of the codec: numbers of views and stages, image sides."""

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
MAX_STAGES = 2
MAX_SH_DEGREE = 2
DEFAULT_MAX_PIXELS = 1 << 22  # pixels of all views that `decode` accepts by default
FEW_VIEWS, MANY_VIEWS_MAX_PIXELS = 4, 1_400_000
"""More than FEW_VIEWS views have at most so many pixels together, unless the user sets a size: 16 take 2.8 GiB."""
