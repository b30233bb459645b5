"""Read the photographs of a folder by role, and encode them as its options say."""

from dataclasses import dataclass, replace
from functools import partial

import torch

from fecocodec.captures.chosen_photographs import ChosenPhotographs
from fecocodec.captures.scene_folder import read_others, read_pixels
from fecocodec.codec.messages import Messages, OnMessage
from fecocodec.codec.options import EncodingOptions
from fecocodec.container import with_metadata
from fecocodec.errors import InputError, error_context
from fecocodec.geometry.views import Views
from fecocodec.progress import OnProgress
from fecocodec.sender.encode import encode
from fecocodec.sender.exposure import exposure_factors, with_factors
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.rate_control import encode_to_target


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
    if colour is None:  # a background that was put in has no exposure
        return _with_one_exposure(Photographs(views, taught, kept_back), messages)
    return Photographs(views, taught, kept_back)


def _with_one_exposure(found: Photographs, messages: Messages) -> Photographs:
    """Return the photographs with the exposure and white balance of those beside them."""
    others = [part for part in (found.guides, found.checks) if part is not None]
    factors = exposure_factors([found.views, *others])
    if factors is None:
        return found
    largest = max(float(torch.maximum(of_part, 1.0 / of_part).max()) for of_part in factors) - 1.0
    messages.note(f"exposures or white balances differ by up to {largest:.0%} between neighbours; they are made alike.")
    of_views, *of_others = factors
    adapted = [with_factors(*pair) for pair in zip(others, of_others, strict=True)]
    guides = None if found.guides is None else adapted[0]
    return Photographs(with_factors(found.views, of_views), guides, None if found.checks is None else adapted[-1])


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


def encode_views(
    views: Views,
    guides: Views | None,
    checks: Views | None,
    options: EncodingOptions,
    messages: Messages,
    on_progress: OnProgress,
) -> bytes:
    """Return the bytes of the file. checks: choose lambda for a PSNR of new views, else nothing. Raises InputError."""
    messages.warn(*check_input(views, options.effort, guides))
    if options.target is None:
        coder = partial(encode, lmbda=options.lmbda, num_stages=options.num_stages)
    else:
        coder = partial(
            encode_to_target,
            target=options.target,
            checks=checks,
            on_lambda=lambda lmbda: messages.note(f"lambda {lmbda:.3g} reaches the target."),
        )
    with error_context(messages.path, (InputError,)):
        data = coder(
            views,
            guides=guides,
            effort=options.effort,
            sharpness=options.sharpness,
            device=options.device,
            model=options.model,
            on_progress=on_progress,
            on_warning=messages.warn,
            on_omission=messages.omit,
        )
    return with_metadata(data, options.metadata) if options.metadata else data
