"""Quality of the context views as decoded: decode the stream, render at its cameras, compare with the photographs."""

from pathlib import Path

import torch

from fecocodec.checkpoint import model_folder
from fecocodec.container import Stages, read_stream
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.coverage import BLACK, WHITE
from fecocodec.sender.view_quality import DecodedQuality

LARGEST_PSNR = 100.0  # dB; that of equal images would be infinite


def measure_decoded(
    data: bytes, views: Views, *, device: str = "cpu", model: Path | str | None = None
) -> tuple[DecodedQuality, ...]:
    """Decode a stream that was encoded from `views`, in this order, and return their quality after each stage.

    The detail layer counts as a part of the last stage.
    device, model: as for `encode`. Raises BitstreamError for an invalid stream, ModelError if weights cannot be loaded,
    InputError for another number of views than the stream has.
    """
    stream = read_stream(data)
    if len(views.images) != stream.header.num_views:
        raise InputError(
            f"the stream holds {stream.header.num_views} views, but {len(views.images)} are given to compare it with; "
            "give the views that it was encoded from, in their order."
        )
    receiver = load_codec(model_folder(model), device).receiver
    parts: list[Stages] = [*range(1, len(stream.payloads)), "all"]
    return tuple(decoded_quality(receiver, data, views, part) for part in parts)


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


@torch.no_grad()
def decoded_quality(receiver: Receiver, data: bytes, views: Views, stages: Stages = "all") -> DecodedQuality:
    """Decode `stages`, as for `decode`, with a loaded receiver, and return the quality of the context views.

    Transparent photographs are white where they are transparent, and so is the background of their renderings.
    """
    decoded = decode_with(receiver, data, stages=stages)
    return _quality(decoded.gaussians, decoded.cameras, views)


def _quality(gaussians: Gaussians, cameras: Cameras, views: Views) -> DecodedQuality:
    background = BLACK if views.alpha is None else WHITE
    rendered = render(gaussians, cameras, views.image_size, background).color
    quality = psnr(rendered.clamp(0, 1), views.images.to(rendered), views.ignored).clamp(max=LARGEST_PSNR)
    return DecodedQuality(tuple(quality.tolist()))
