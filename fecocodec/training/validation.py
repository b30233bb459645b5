"""Validation during training: rate and quality of held-out scenes, from streams that are encoded and decoded."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import fmean

import torch
from torch import Tensor, nn

from fecocodec.container import dequantise_lambda
from fecocodec.limits import MAX_STAGES
from fecocodec.model_files import MODEL_ID_BYTES
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.optimisation_config import FAST
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.samples import Sample, SampleSource

_SEED = 21


@dataclass(frozen=True)
class ValidationRow:
    """Means over the held-out scenes at one lambda. bpp: bits of the streams per context pixel. psnr in dB."""

    lmbda: float
    bpp: float
    psnr: float
    st_lpips: float


def draw_validation_scenes(source: SampleSource, shape: BatchShape, num_scenes: int) -> tuple[Sample, ...]:
    """Draw scenes, equal in every run with the same source and shape."""
    generator = torch.Generator().manual_seed(_SEED)
    size = {"num_context": shape.num_context, "num_target": shape.num_target, "size": shape.size}
    return tuple(source.sample(generator, **size) for _ in range(num_scenes))  # type: ignore[arg-type]


def validate(codec: Codec, samples: tuple[Sample, ...], lambda_q_range: tuple[int, int]) -> tuple[ValidationRow, ...]:
    """Encode, decode and render the scenes at the ends and the middle of a range of quantised lambda.

    Latents are not optimised. A model of three stages is measured with the two that a stream holds.
    """
    lowest, highest = lambda_q_range
    lambdas = sorted({lowest, (lowest + highest) // 2, highest})
    return tuple(_row(codec, samples, lambda_q) for lambda_q in lambdas)


def means_of(rows: tuple[ValidationRow, ...]) -> dict[str, float]:
    """Return the means over the values of lambda, by column of the log."""
    return {
        "val_psnr": fmean(row.psnr for row in rows),
        "val_st_lpips": fmean(row.st_lpips for row in rows),
        "val_bpp": fmean(row.bpp for row in rows),
    }


@contextmanager
def weights_replaced(networks: nn.Module, weights: dict[str, Tensor]) -> Iterator[None]:
    """Give the networks other weights, a whole state dict, for the duration of the context."""
    before = {name: value.detach().clone() for name, value in networks.state_dict().items()}
    networks.load_state_dict(weights)
    try:
        yield
    finally:
        networks.load_state_dict(before)


def _row(codec: Codec, samples: tuple[Sample, ...], lambda_q: int) -> ValidationRow:
    scores = [_score(codec, sample, lambda_q) for sample in samples]
    bpp, quality, distance = (fmean(values) for values in zip(*scores, strict=True))
    return ValidationRow(dequantise_lambda(lambda_q), bpp, quality, distance)


@torch.no_grad()
def _score(codec: Codec, sample: Sample, lambda_q: int) -> tuple[float, float, float]:
    """Return bits per context pixel, PSNR and ST-LPIPS of the target views of one scene."""
    context = sample.views.select(list(range(sample.num_context)))
    data = encode_with(codec, context, lambda_q, MAX_STAGES, FAST)
    gaussians = decode_with(codec.receiver, data).gaussians.to(codec.device)
    targets = sample.views.select(list(range(sample.num_context, len(sample.views.images))))
    cameras = targets.cameras.to(codec.device)
    images = render(gaussians, cameras, targets.image_size).color.clamp(0.0, 1.0).cpu()
    height, width = context.image_size
    return (
        8 * len(data) / (sample.num_context * height * width),
        float(psnr(images, targets.images).mean()),
        float(st_lpips(images, targets.images).mean()),
    )


def validation_codec(networks: nn.ModuleDict) -> Codec:
    """Return the networks of a training run as a codec, with an id that no model has."""
    return Codec(networks["sender"], networks["receiver"], bytes(MODEL_ID_BYTES))  # type: ignore[arg-type]
