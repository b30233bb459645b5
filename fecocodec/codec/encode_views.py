"""Read the photographs of a folder by role, and encode them as its options say."""

from dataclasses import dataclass, replace
from functools import partial, reduce

import torch

from fecocodec.captures.chosen_photographs import ChosenPhotographs
from fecocodec.captures.scene_folder import read_others, read_unbounded, with_depth_bounds
from fecocodec.codec.messages import Messages, OnMessage
from fecocodec.codec.options import EncodingOptions
from fecocodec.container import with_metadata
from fecocodec.errors import InputError, error_context
from fecocodec.geometry.bundle_adjustment import adjusted_with_checks
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.sparse_matches import Corners, corners_of
from fecocodec.geometry.views import Views, with_cameras
from fecocodec.progress import OnProgress
from fecocodec.sender.encode import encode
from fecocodec.sender.exposure import exposure_factors, with_factors
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.lambda_search import target_note
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
    views, taught, kept_back = read_unbounded(context, colour, masks), None, None
    are_named = isinstance(options.guides, tuple)
    if guides is not None:
        taught = read_others(guides, background=colour, masks=masks, on_left_out=None if are_named else messages.omit)
    if checks is not None:
        kept_back = read_others(checks, background=colour, masks=masks, on_left_out=messages.omit)
    if taught is not None:
        taught = _alike(taught, views, messages.refuse if are_named else messages.omit)
    if kept_back is not None:
        kept_back = _alike(kept_back, views, messages.omit)
    parts = [part for part in (views, taught, kept_back) if part is not None]
    corners = [found for part in parts for found in corners_of(part.images, part.ignored)]
    num_checks = 0 if kept_back is None else len(kept_back.names)
    parts = _with_fitting_cameras(parts, corners, num_checks, messages)
    if colour is None:  # a background that was put in has no exposure
        parts = _with_one_exposure(parts, corners, messages)
    taught = None if taught is None else parts[1]
    views = with_depth_bounds(context, parts[0], options.near, options.far, taught)
    bounds = float(views.cameras.near), float(views.cameras.far)
    return Photographs(
        views,
        None if taught is None else taught.within(*bounds),
        None if kept_back is None else parts[-1].within(*bounds),
    )


def _with_fitting_cameras(
    parts: list[Views], corners: list[Corners], num_checks: int, messages: Messages
) -> list[Views]:
    """Return the photographs with cameras at which points that look alike meet. num_checks: of the last part."""
    cameras = reduce(Cameras.joined, (part.cameras for part in parts))
    cameras, better = adjusted_with_checks(cameras, corners, num_checks, parts[0])
    if better is not None:
        messages.note(better.remark)
    return with_cameras(parts, cameras)


def _with_one_exposure(parts: list[Views], corners: list[Corners], messages: Messages) -> list[Views]:
    """Return the photographs with the exposure and white balance of those beside them."""
    factors = exposure_factors(parts, corners)
    if factors is None:
        return parts
    largest = max(float(torch.maximum(of_part, 1.0 / of_part).max()) for of_part in factors) - 1.0
    differ = f"exposures or white balances differ by up to {largest:.0%} between neighbours"
    messages.note(f"{differ}; they are made alike, and PSNR compares with these changed photographs.")
    return [with_factors(*pair) for pair in zip(parts, factors, strict=True)]


def _alike(others: Views, views: Views, on_left_out: OnMessage) -> Views | None:
    """Return the photographs that are cut out or opaque as the coded ones are."""
    is_cut_out, are_cut_out = any(_are_cut_out(views)), _are_cut_out(others)
    kept = [index for index, other in enumerate(are_cut_out) if other == is_cut_out]
    if unlike := [name for index, name in enumerate(others.names) if index not in kept]:
        found, usual = ("opaque", "cut out") if is_cut_out else ("transparent in part", "opaque")
        on_left_out(
            f"left out {', '.join(unlike)}, {found}, while the coded photographs are {usual}; cut out the object in "
            "all, or give all without transparency."
        )
    return replace(others, alpha=others.alpha if is_cut_out else None).select(kept) if kept else None


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
    if (target := options.target) is None:
        coder = partial(encode, lmbda=options.lmbda, num_stages=options.num_stages)
    else:
        coder = partial(
            encode_to_target,
            target=target,
            checks=checks,
            on_lambda=lambda lmbda: messages.note(target_note(lmbda, target)),
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
