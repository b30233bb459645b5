"""Which photographs guide, and why others are not used."""

from collections.abc import Collection, Iterable, Mapping
from statistics import fmean

from fecocodec.captures.view_selection import Guides, Spread
from fecocodec.captures.view_spread import Overlap, is_duplicate, k_centres, within_reach

MAX_GUIDES = 24  # unless a number is asked for
# Why a photograph is not used, for messages.
TOO_FAR = "too little overlap with the coded views"
OTHER_SHAPE = "another shape than the coded views, and too little overlap to guide"
SAME_POSITION = "same position and view as a coded one"
BEYOND = "beyond {} guides"
NOT_NAMED = "not named in `guides`"
NO_GUIDES = "`guides` is none"
COPY = "copy of another one"


def chosen_guides(
    overlap: Overlap, baseline: Overlap, context: list[int], others: list[int], guides: Guides
) -> list[int]:
    """Return up to MAX_GUIDES of the others, or as many as `guides` says, that overlap with the coded photographs.

    They are as far from these and from each other as they are. overlap, baseline: of all photographs.
    """
    apart = [index for index in others if not is_duplicate(overlap[index, context], baseline[index, context])]
    return sorted(k_centres(overlap, context, within_reach(overlap, apart, context), _most(guides)))


def reasons(
    overlap: Overlap,
    baseline: Overlap,
    context: list[int],
    unused: Iterable[int],
    guides: Guides,
    misshapen: Collection[int] = (),
) -> dict[str, list[int]]:
    """Return the photographs that are not used by the reason for it. Other arguments as for `chosen_guides`.

    misshapen: those that could not be coded because of their shape.
    """
    found = dict[str, list[int]]()
    for index in unused:
        if not within_reach(overlap, [index], context):
            reason = OTHER_SHAPE if index in misshapen else TOO_FAR
        elif isinstance(guides, tuple):
            reason = NOT_NAMED if guides else NO_GUIDES
        elif is_duplicate(overlap[index, context], baseline[index, context]):
            reason = SAME_POSITION
        else:
            reason = BEYOND.format(_most(guides))
        found.setdefault(reason, []).append(index)
    return found


def shown_note(num_coded: int, shares: Mapping[int, float], too_far: Collection[int]) -> str:
    """Return a sentence on what the coded photographs show of those that overlap with them.

    shares: that they show of each photograph, by its index. too_far: indices of those not used because of TOO_FAR.
    """
    shown = fmean(share for index, share in shares.items() if index not in too_far)
    but = f" except {len(too_far)} with too little overlap" if too_far else ""
    return f"{num_coded} photographs are coded; on average they show {shown:.0%} of each photograph{but}."


def _most(guides: Guides) -> int:
    return guides.count if isinstance(guides, Spread) else MAX_GUIDES
