"""Limits of the codec: numbers of views and stages, image sides, depths; and cores of the machine."""

import math
import os
from collections.abc import Sequence

from fecocodec.errors import InputError
from fecocodec.grid import HYPERLATENTS

MAX_VIEWS = 16
MIN_SIDE, MAX_SIDE = 64, 1024  # pixels, of every view
MAX_STAGES = 2
MAX_SH_DEGREE = 2
DEFAULT_MAX_PIXELS = 1 << 22  # pixels of all views that `decode` accepts by default
FEW_VIEWS, MANY_VIEWS_MAX_PIXELS = 4, 1_400_000
"""More than FEW_VIEWS views have at most so many pixels together, unless the user sets a size: 16 take 2.8 GiB."""
_LARGEST_DEPTH = 2.0**128  # of float32


def require_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return `size` = (height, width). Raises InputError if it is outside the limits of the codec."""
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in size):
        raise InputError(
            f"size {size[1]}x{size[0]}: each side must have {MIN_SIDE} to {MAX_SIDE} pixels; choose another `size`."
        )
    return size


def require_depths(near: float, far: float, place: str = "") -> None:
    """Raise InputError, which begins with `place`, if near and far are no range of depths."""
    if not 0 < near < far < _LARGEST_DEPTH:
        raise InputError(
            f"{place}near {near:.6g} and far {far:.6g} are no range of depths; "
            "0 < near < far is needed, set them with `near` and `far`."
        )


def check_view_shares(view_shares: Sequence[tuple[int, float]]) -> None:
    """Raise InputError for a number of context views, or a relative frequency, that cannot be trained."""
    for count, share in view_shares:
        if not 1 <= count <= MAX_VIEWS or not 0 < share < math.inf:
            raise InputError(
                f"{count} context views with share {share:g} cannot be trained; "
                f"give 1 to {MAX_VIEWS} views and positive shares."
            )


def check_sizes(sizes: Sequence[tuple[int, int]]) -> None:
    """Raise InputError for a side that is not a multiple of 32 within the limits of the codec."""
    for side in (side for size in sizes for side in size):
        if side % HYPERLATENTS or not MIN_SIDE <= side <= MAX_SIDE:
            raise InputError(
                f"A training image side of {side} pixels cannot be used; "
                f"choose a multiple of {HYPERLATENTS} from {MIN_SIDE} to {MAX_SIDE}."
            )


def num_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
