"""Quality of the context views as decoded: decode the stream, render at its cameras, compare with the photographs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import numpy as np
import torch

from fecocodec.checkpoint import model_folder
from fecocodec.coding.visibility import FACTOR_OF_LEVEL, pack_levels, unpack_levels
from fecocodec.container import FADING_BLOCKS, read_stream
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.merging.grouping import DEFAULT_MERGING
from fecocodec.receiver.decode import decode_with, emission_of, predict_with
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.coverage import BLACK, WHITE
from fecocodec.sender.view_quality import DecodedQuality, LeftOutQuality

MAX_LEFT_OUT = 8  # views; each takes an emission
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
    return measure_with_others(data, views, (), device=device, model=model, is_merged=is_merged)[0]


@torch.no_grad()
def measure_with_others(
    data: bytes,
    views: Views,
    others: Sequence[Views | None],
    *,
    device: str = "cpu",
    model: Path | str | None = None,
    is_merged: bool = True,
) -> tuple[tuple[DecodedQuality, ...], tuple[DecodedQuality | None, ...]]:
    """Return what `measure_decoded` does, and the quality of photographs that are not in the stream.

    others: groups of photographs, with cameras in the frame of the encoded views; None for no photographs, of which the
    quality is None. Other arguments and errors as for `measure_decoded`.
    """
    stream = read_stream(data)
    header = stream.header
    held, given = (header.num_views, header.height, header.width), (len(views.images), *views.image_size)
    if held != given:
        count, height, width = held
        raise InputError(
            f"the stream holds {count} views of {width}x{height}, but {given[0]} of {given[2]}x{given[1]} are given to "
            "compare it with; give the views that it was encoded from, in their order."
        )
    receiver, merging = load_codec(model_folder(model), device).receiver, DEFAULT_MERGING if is_merged else None
    earlier = (decode_with(receiver, data, stages=part, merging=merging) for part in range(1, len(stream.payloads)))
    of_earlier = tuple(_quality(decoded.gaussians, decoded.cameras, views) for decoded in earlier)
    decoded = decode_with(receiver, data, merging=merging)
    of_others = tuple(None if group is None else _quality(decoded.gaussians, group.cameras, group) for group in others)
    return (*of_earlier, _quality(decoded.gaussians, decoded.cameras, views)), of_others


@torch.no_grad()
def left_out_quality(receiver: Receiver, data: bytes, views: Views) -> LeftOutQuality | None:
    """Decode a stream without the Gaussians of one view after another, and return the quality of these views.

    At most MAX_LEFT_OUT views are measured. Pixels count where the Gaussians of the other views are nearly opaque, so
    what the background layer fills does not. None if no view shows what another one does. data, views: as for
    `measure_decoded`. Raises BitstreamError for an invalid stream.
    """
    predicted = predict_with(receiver, data)
    stream, emission = predicted.stream, emission_of(background=None)
    levels = np.zeros(FADING_BLOCKS.shape(stream.header), np.uint8)
    if stream.fading is not None:
        levels = unpack_levels(stream.fading, stream.header)
    found: dict[int, float] = {}
    shares = []
    for view in range(0, len(levels), -(-len(levels) // MAX_LEFT_OUT)):
        hidden = levels.copy()
        hidden[view] = len(FACTOR_OF_LEVEL) - 1
        decoded = replace(predicted, stream=replace(stream, fading=pack_levels(hidden))).decoded(emission)
        rendered = render(decoded.gaussians, decoded.cameras.select([view]), views.image_size, _background(views))
        is_unseen = rendered.alpha < OPAQUE
        if views.ignored is not None:
            is_unseen |= views.ignored[[view]]
        shares.append(1.0 - float(is_unseen.float().mean()))
        if shares[-1] > LEAST_SHOWN:
            truth = views.images[[view]].to(rendered.color)
            found[view] = float(psnr(rendered.color.clamp(0, 1), truth, is_unseen))
    return LeftOutQuality(found, fmean(shares)) if found else None


@torch.no_grad()
def decoded_quality(receiver: Receiver, data: bytes, views: Views, cameras: Cameras | None = None) -> DecodedQuality:
    """Decode with a loaded receiver, and return the quality of the context views, or of others.

    cameras: of photographs that are not in the stream; None for those of the stream. Transparent photographs are white
    where they are transparent, and so is the background of their renderings.
    """
    decoded = decode_with(receiver, data)
    return _quality(decoded.gaussians, cameras or decoded.cameras, views)


def _background(views: Views) -> tuple[float, float, float]:
    """Return what is behind the Gaussians, sRGB: transparent photographs are white where they are transparent."""
    return BLACK if views.alpha is None else WHITE


def _quality(gaussians: Gaussians, cameras: Cameras, views: Views) -> DecodedQuality:
    rendered = render(gaussians, cameras, views.image_size, _background(views)).color
    quality = psnr(rendered.clamp(0, 1), views.images.to(rendered), views.ignored).clamp(max=LARGEST_PSNR)
    return DecodedQuality(tuple(quality.tolist()))
