"""Limits of the codec: numbers of views and stages, image sides."""

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
MAX_STAGES = 2
MAX_SH_DEGREE = 1
DEFAULT_MAX_PIXELS = 1 << 22  # pixels of all views that `decode` accepts by default
