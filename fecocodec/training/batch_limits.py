"""Limits of numbers of views and image sizes in training. They are checked before torch is loaded."""

import math
from collections.abc import Sequence

from fecocodec.errors import InputError
from fecocodec.grid import HYPERLATENTS
from fecocodec.limits import MAX_SIDE, MAX_VIEWS, MIN_SIDE


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
