"""The symbols of a stream, as the product decodes them."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from jaxtyping import Int64
from torch import Tensor

from fecocodec.checkpoint import find_receiver
from fecocodec.coding.payload import CodedLatents, decode_latents
from fecocodec.coding.priors import LatentPrior
from fecocodec.container import PackedCameras, Stream
from fecocodec.errors import BitstreamError
from fecocodec.receiver.load import load_receiver
from tests.vectors.tiny_model import tiny_model_id, tiny_prior


@dataclass(frozen=True)
class StageValues:
    """Symbols by batch, in the order of their arrays; values Q8, [view row column channel]."""

    batches: list[np.ndarray]
    z_hat: Int64[np.ndarray, "view row column channel"]
    y_hat: Int64[np.ndarray, "view row column channel"]


@cache
def prior_of(model_id: bytes) -> LatentPrior:
    """The entropy model of that id; raises ModelError where there is none."""
    if model_id == tiny_model_id():
        return tiny_prior()
    return load_receiver(find_receiver(model_id))[0].prior


def decode_symbols(stream: Stream) -> list[StageValues]:
    """Every stage; raises BitstreamError for a digest that does not hold."""
    header, found = stream.header, list[CodedLatents]()
    prior = prior_of(header.model_id)
    height, width = header.grid_size
    size = (header.num_views, height // 8, width // 8)
    for stage, payload in enumerate(stream.payloads, start=1):
        context = found[0].y_hat if found else None
        found.append(decode_latents(prior, payload, size, header.lambda_q_of_stage(stage), stage, context))
        if found[-1].digest() != header.symbol_digests[stage - 1]:
            raise BitstreamError(f"stage {stage}: the decoded symbols have another digest; the file is damaged.")
    return [StageValues(list(c.symbols), _q8(c.z_hat), _q8(c.y_hat)) for c in found]


def _q8(values: Tensor) -> np.ndarray:
    """Clipped to +-2^24: beyond, the product keeps them as float32, and no layer sees more than 16 bits."""
    return (values.permute(0, 2, 3, 1).to(torch.float64) * 256).clamp(-(1 << 24), 1 << 24).to(torch.int64).numpy()


def fingerprint(values: np.ndarray | Sequence[int]) -> str:
    """SHA-256, 16 hexadecimal digits, of values as little-endian int64."""
    return hashlib.sha256(np.asarray(values, dtype="<i8").tobytes()).hexdigest()[:16]


def camera_fingerprint(cameras: PackedCameras) -> str:
    """SHA-256, 16 hexadecimal digits, of near, far, then fx fy cx cy and rows 1 to 3 of camera-to-world of each view,
    as little-endian float32.
    """
    values = [cameras.near, cameras.far]
    for lens, pose in zip(cameras.intrinsics, cameras.extrinsics, strict=True):
        values += [*lens, *pose]
    return hashlib.sha256(np.array(values, dtype="<f4").tobytes()).hexdigest()[:16]
