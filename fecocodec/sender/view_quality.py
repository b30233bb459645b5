"""Quality of decoded views as recorded, and the warnings that rest on it. Needs no torch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median

from fecocodec.limits import MAX_VIEWS

LEAST_LOSS = 0.1  # of the mean PSNR, in dB, for which a file of one stage is written
# Mean PSNR in dB, below which `quality_warnings` calls the views poor. On six training captures, photographs between
# the coded views had 15.6 to 20.6 dB where those were below it, else 23 dB or more (docs/what_we_learned.md).
LEAST_PSNR = 22.0
# Mean PSNR in dB of views from the others' Gaussians, below which `left_out_warnings` calls new views poor. On training
# captures, the six entries of 15 below it had new views of 11 to 16 dB (docs/what_we_learned.md). Not known of other
# models than the shipped one.
LEAST_LEFT_OUT_PSNR = 17.0
# dB by which a view may be worse from the others' Gaussians than the median of the others. On training captures, 4% of
# the scenes with right cameras have such a view, and 40% of those with one camera turned by 15 degrees. Two of eight
# captures (dorm_room, museum_head; fast, 192x192) have a coded view so far below the others as decoded.
LARGEST_GAP, LEAST_COMPARED = 6.0, 3
# The last advice, as most cameras are right: of cameras that were given, and of those estimated from the photographs.
CHECK_CAMERAS = "check that each camera belongs to its photograph"
TAKE_AGAIN = "take photographs that overlap more (the estimated cameras may be wrong)"
LEAST_NEW_PSNR = 20.0  # dB, mean of photographs that were not used, below which `new_view_warnings` calls them poor


@dataclass(frozen=True)
class DecodedQuality:
    """Quality of decoded views. psnr_of_view: PSNR of each view in dB, at most 100."""

    psnr_of_view: tuple[float, ...]

    @property
    def psnr(self) -> float:
        """Mean PSNR over the views, in dB."""
        return sum(self.psnr_of_view) / len(self.psnr_of_view)

    @property
    def worst_view(self) -> int:
        """Index of the view with the smallest PSNR."""
        return self.psnr_of_view.index(min(self.psnr_of_view))


@dataclass(frozen=True)
class LeftOutQuality:
    """Quality of coded views, each rendered without its own Gaussians.

    psnr_of_view: in dB, of the pixels that other views show, by the index of the view; views that have no such pixels,
    and every second or third of many views, are missing. share: of these pixels.
    """

    psnr_of_view: Mapping[int, float]
    share: float

    @property
    def psnr(self) -> float:
        """Mean PSNR over the views, in dB."""
        return fmean(self.psnr_of_view.values())


def left_out_warnings(quality: LeftOutQuality, names: Sequence[str], *, are_estimated: bool = False) -> tuple[str, ...]:
    """Return one sentence if the coded views do not predict each other, or all but one do.

    names: of the views. are_estimated: whether their cameras were not given.
    """
    if quality.psnr < LEAST_LEFT_OUT_PSNR:
        advice = _either(["add photographs between them", _on_cameras(are_estimated)])
        return (
            "new views will be poor: each coded view, rendered from the others alone, has a PSNR of "
            f"{quality.psnr:.1f} dB where they show it; {advice}.",
        )
    worst = min(quality.psnr_of_view, key=lambda view: quality.psnr_of_view[view])
    others = [value for view, value in quality.psnr_of_view.items() if view != worst]
    found = quality.psnr_of_view[worst]
    if len(others) + 1 < LEAST_COMPARED or median(others) - found < LARGEST_GAP:
        return ()
    return (
        f"{names[worst]} does not fit the other views: from their Gaussians alone it has a PSNR of {found:.1f} dB, "
        f"they have {median(others):.1f} dB; {_on_view(are_estimated)}.",
    )


def quality_warnings(
    quality: DecodedQuality, names: tuple[str, ...], effort: str = "default", *, are_estimated: bool = False
) -> tuple[str, ...]:
    """Return one sentence if the decoded context views are poor, with what helps.

    quality: after the last stage. names: of the views. effort: with which they were encoded. are_estimated: whether
    their cameras were not given. The result is empty if their mean PSNR is LEAST_PSNR or more.
    """
    if quality.psnr >= LEAST_PSNR:
        return ()
    found = f"the decoded views are poor, with a PSNR of {quality.psnr:.1f} dB"
    smaller = ["use a smaller lambda", "use a larger `size`"]
    if len(names) == 1:
        return (f"{found}; {_either([*_other_effort(effort), *smaller])}.",)
    worst = quality.worst_view
    found += f" (worst {names[worst]}, {quality.psnr_of_view[worst]:.1f} dB), and images between them will be worse"
    closer = ["choose fewer `views`, which are closer together"]
    if len(names) == 2:
        closer = [*smaller, "choose two views closer together"]
    return (f"{found}; {_either([*_other_effort(effort), *closer, _on_cameras(are_estimated)])}.",)


def worst_view_warnings(
    quality: DecodedQuality, names: Sequence[str], *, are_estimated: bool = False
) -> tuple[str, ...]:
    """Return one sentence if the worst decoded context view is poor and far worse than the others.

    quality: after the last stage. Other arguments as for `left_out_warnings`.
    """
    worst = quality.worst_view
    found, *others = sorted(quality.psnr_of_view)
    if len(others) + 1 < LEAST_COMPARED or found >= LEAST_PSNR or median(others) - found < LARGEST_GAP:
        return ()
    return (
        f"{names[worst]} is decoded far worse than the other views: it has a PSNR of {found:.1f} dB, they have "
        f"{median(others):.1f} dB; {_on_view(are_estimated)}.",
    )


def new_view_warnings(
    quality: DecodedQuality,
    names: tuple[str, ...],
    num_coded: int,
    is_any_left: bool,
    effort: str = "default",
    *,
    are_estimated: bool = False,
) -> tuple[str, ...]:
    """Return one sentence if new views are poor, with what helps.

    quality, names: of photographs that were not used. num_coded: number of coded views. is_any_left: whether further
    photographs could be coded. effort, are_estimated: as for `quality_warnings`.
    """
    if quality.psnr >= LEAST_NEW_PSNR:
        return ()
    worst = names[quality.worst_view]
    measured = worst if len(names) == 1 else f"worst {worst}, {min(quality.psnr_of_view):.1f} dB"
    advice = _other_effort(effort) if effort == "fast" else []
    advice.append("add photographs between the coded ones")
    if num_coded >= MAX_VIEWS:
        advice.append(f"encode a smaller part of the scene, as a file holds at most {MAX_VIEWS} coded views")
    elif is_any_left:
        advice.append("code more of them by `views`")
    advice.append(_on_cameras(are_estimated))
    return (
        f"new views are poor, with a PSNR of {quality.psnr:.1f} dB, measured on {photographs(len(names))} "
        f"({measured}); {_either(advice)}.",
    )


def _other_effort(effort: str) -> list[str]:
    """Return the advice to take a higher effort than the given one; empty if there is none."""
    if effort == "fast":
        return ["leave out `effort=fast`"]
    return ["use `effort=best`"] if effort == "default" else []


def _on_cameras(are_estimated: bool) -> str:
    """Return the advice on the cameras of a scene."""
    return TAKE_AGAIN if are_estimated else CHECK_CAMERAS


def _on_view(are_estimated: bool) -> str:
    """Return the advice on one view that does not fit the others."""
    of_given = [] if are_estimated else ["check that its camera belongs to it"]
    return _either(["add photographs beside it", "leave it out by `views`", *of_given])


def _either(advice: Sequence[str]) -> str:
    """Return advice of which each alone may help: `a, b, or c`."""
    *others, last = advice
    return f"{', '.join(others)}, or {last}" if others else last


def photographs(count: int) -> str:
    """Return how many photographs were measured, for messages."""
    return "one photograph that was not used" if count == 1 else f"{count} photographs that were not used"


def is_lowered_by_stage_2(quality: Sequence[DecodedQuality]) -> bool:
    """Return whether the decoded context views lose LEAST_LOSS or more by stage 2. quality: after each stage."""
    return quality[-1].psnr <= quality[0].psnr - LEAST_LOSS


def stage_2_note(quality: Sequence[DecodedQuality]) -> str:
    """Return the sentence about a file of one stage that takes the place of one of this quality after each stage."""
    change = f"from {quality[0].psnr:.2f} to {quality[-1].psnr:.2f} dB"
    return f"stage 2 would lower the PSNR of the decoded views {change}; the file holds stage 1 alone."
