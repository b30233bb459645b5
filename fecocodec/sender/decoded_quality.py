"""Quality of the context views as decoded: decode the stream, render at its cameras, compare with the photographs."""

from dataclasses import replace
from pathlib import Path
from statistics import fmean

import numpy as np
import torch

from fecocodec.checkpoint import model_folder
from fecocodec.coding.visibility import FACTOR_OF_LEVEL, pack_levels, unpack_levels
from fecocodec.container import FADING_BLOCKS, Stages, read_stream, write_stream
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.merging.grouping import DEFAULT_MERGING
from fecocodec.receiver.decode import decode_with
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.coverage import BLACK, WHITE
from fecocodec.sender.view_quality import DecodedQuality, LeftOutQuality

MAX_LEFT_OUT = 8  # views; each takes a decoding
OPAQUE, LEAST_SHOWN = 0.5, 0.05  # alpha of pixels that other views show; share of a view that they must show
LARGEST_PSNR = 100.0  # dB; that of equal images would be infinite


def measure_decoded(
    data: bytes, views: Views, *, device: str = "cpu", model: Path | str | None = None, is_merged: bool = True
) -> tuple[DecodedQuality, ...]:
    """Decode a stream that was encoded from `views`, in this order, and return their quality after each stage.

    The detail layer counts as a part of the last stage.
    device, model: as for `encode`. is_merged: as for `decode`. Raises BitstreamError for an invalid stream, ModelError
    if weights cannot be loaded, InputError for another number of views than the stream has.
    """
    stream = read_stream(data)
    if len(views.images) != stream.header.num_views:
        raise InputError(
            f"the stream holds {stream.header.num_views} views, but {len(views.images)} are given to compare it with; "
            "give the views that it was encoded from, in their order."
        )
    receiver = load_codec(model_folder(model), device).receiver
    parts: list[Stages] = [*range(1, len(stream.payloads)), "all"]
    return tuple(decoded_quality(receiver, data, views, part, is_merged) for part in parts)


@torch.no_grad()
def measure_others(
    data: bytes, *groups: Views | None, device: str = "cpu", model: Path | str | None = None
) -> tuple[DecodedQuality | None, ...]:
    """Decode a stream and return the quality of groups of photographs that are not in it, at their own cameras.

    groups: with cameras in the frame of the encoded views; None for no photographs, of which the quality is None.
    device, model, errors: as for `measure_decoded`.
    """
    if not any(groups):
        return (None,) * len(groups)
    receiver = load_codec(model_folder(model), device).receiver
    gaussians = decode_with(receiver, data).gaussians
    return tuple(None if views is None else _quality(gaussians, views.cameras, views) for views in groups)


def measure_left_out(
    data: bytes, views: Views, *, device: str = "cpu", model: Path | str | None = None
) -> LeftOutQuality | None:
    """Decode a stream without the Gaussians of one view after another, and return the quality of these views.

    At most MAX_LEFT_OUT views are measured. Pixels count where the Gaussians of the other views are nearly opaque, so
    what the background layer fills does not.
    Arguments and errors as for `measure_decoded`. None if no view shows what another one does.
    """
    return left_out_quality(load_codec(model_folder(model), device).receiver, data, views)


@torch.no_grad()
def left_out_quality(receiver: Receiver, data: bytes, views: Views) -> LeftOutQuality | None:
    """Return what `measure_left_out` does, with a loaded receiver."""
    stream = read_stream(data)
    levels = np.zeros(FADING_BLOCKS.shape(stream.header), np.uint8)
    if stream.fading is not None:
        levels = unpack_levels(stream.fading, stream.header)
    found, shares = [], []
    for view in range(0, len(levels), -(-len(levels) // MAX_LEFT_OUT)):
        hidden = levels.copy()
        hidden[view] = len(FACTOR_OF_LEVEL) - 1
        decoded = decode_with(receiver, write_stream(replace(stream, fading=pack_levels(hidden))), background=None)
        rendered = render(decoded.gaussians, decoded.cameras.select([view]), views.image_size, _background(views))
        is_unseen = rendered.alpha < OPAQUE
        if views.ignored is not None:
            is_unseen |= views.ignored[[view]]
        shares.append(1.0 - float(is_unseen.float().mean()))
        if shares[-1] > LEAST_SHOWN:
            found.append(float(psnr(rendered.color.clamp(0, 1), views.images[[view]].to(rendered.color), is_unseen)))
    return LeftOutQuality(fmean(found), fmean(shares)) if found else None


@torch.no_grad()
def new_view_quality(receiver: Receiver, data: bytes, views: Views) -> DecodedQuality:
    """Decode with a loaded receiver, and return the quality of photographs that are not in the stream."""
    return _quality(decode_with(receiver, data).gaussians, views.cameras, views)


@torch.no_grad()
def decoded_quality(
    receiver: Receiver, data: bytes, views: Views, stages: Stages = "all", is_merged: bool = True
) -> DecodedQuality:
    """Decode `stages`, as for `decode`, with a loaded receiver, and return the quality of the context views.

    Transparent photographs are white where they are transparent, and so is the background of their renderings.
    """
    merging = DEFAULT_MERGING if is_merged else None
    decoded = decode_with(receiver, data, stages=stages, merging=merging)
    return _quality(decoded.gaussians, decoded.cameras, views)


def _background(views: Views) -> tuple[float, float, float]:
    """Return what is behind the Gaussians, sRGB: transparent photographs are white where they are transparent."""
    return BLACK if views.alpha is None else WHITE


def _quality(gaussians: Gaussians, cameras: Cameras, views: Views) -> DecodedQuality:
    rendered = render(gaussians, cameras, views.image_size, _background(views)).color
    quality = psnr(rendered.clamp(0, 1), views.images.to(rendered), views.ignored).clamp(max=LARGEST_PSNR)
    return DecodedQuality(tuple(quality.tolist()))
