"""Pixels of the photographs of a folder, by role."""

from dataclasses import dataclass, replace

from fecocodec.captures.chosen_photographs import ChosenPhotographs
from fecocodec.captures.scene_folder import read_others, read_pixels
from fecocodec.codec.messages import Messages, OnMessage
from fecocodec.codec.options import EncodingOptions
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Photographs:
    """views: to be coded. guides, checks: of the same size; None for none."""

    views: Views
    guides: Views | None
    checks: Views | None


def read_photographs(
    context: ChosenPhotographs,
    guides: ChosenPhotographs | None,
    checks: ChosenPhotographs | None,
    options: EncodingOptions,
    messages: Messages,
) -> Photographs:
    """Read the photographs. Guides that cannot be used are left out, unless they are named; so are checks.

    Raises InputError for a coded photograph, or a guide that is named, that cannot be used.
    """
    colour, masks = options.background, options.masks
    taught = kept_back = None
    if guides is not None:
        taught = read_others(
            guides, background=colour, masks=masks, on_left_out=None if options.guides else messages.omit
        )
    if checks is not None:
        kept_back = read_others(checks, background=colour, masks=masks, on_left_out=messages.omit)
    views = read_pixels(context, near=options.near, far=options.far, background=colour, masks=masks, guides=taught)
    if taught is not None:
        taught = _alike(taught, views, messages.refuse if options.guides else messages.omit)
    if kept_back is not None:
        kept_back = _alike(kept_back, views, messages.omit)
    return Photographs(views, taught, kept_back)


def _alike(others: Views, views: Views, on_left_out: OnMessage) -> Views | None:
    """Return the photographs that are cut out or opaque as the coded ones are, with the same bounds of depth."""
    is_cut_out, are_cut_out = any(_are_cut_out(views)), _are_cut_out(others)
    kept = [index for index, other in enumerate(are_cut_out) if other == is_cut_out]
    if unlike := [name for index, name in enumerate(others.names) if index not in kept]:
        found, usual = ("opaque", "cut out") if is_cut_out else ("transparent in part", "opaque")
        on_left_out(
            f"left out {', '.join(unlike)}, {found}, while the coded photographs are {usual}; cut out the object in "
            "all, or give all without transparency."
        )
    bounds = replace(others.cameras, near=views.cameras.near, far=views.cameras.far)
    others = replace(others, cameras=bounds, alpha=others.alpha if is_cut_out else None)
    return others.select(kept) if kept else None


def _are_cut_out(views: Views) -> list[bool]:
    """Return which views are transparent in part."""
    if views.alpha is None:
        return [False] * len(views.images)
    return [bool(share < 1.0) for share in views.alpha.mean(dim=(1, 2))]
