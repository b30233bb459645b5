"""Symbols of a stream, decoded by the product."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Int32, Int64, UInt8
from torch import Tensor

from fecocodec.checkpoint import find_receiver
from fecocodec.coding.detail import decode_detail, detail_size, detail_values
from fecocodec.coding.payload import CodedLatents, decode_latents
from fecocodec.coding.priors import LatentPrior
from fecocodec.container import PackedCameras, Stream
from fecocodec.errors import BitstreamError
from fecocodec.receiver.model import load_receiver
from fecocodec.runtime.graphs import bytes_tensor
from tests.vectors.paper_model import PAPER_MODEL, paper_model_id
from tests.vectors.tiny_model import TINY_MODEL, tiny_model_id, tiny_prior


@dataclass(frozen=True)
class StageValues:
    """Symbols by batch, in the order of their arrays; values Q8, [view row column channel]."""

    batches: list[np.ndarray]
    z_hat: Int64[np.ndarray, "view row column channel"]
    y_hat: Int64[np.ndarray, "view row column channel"]


@cache
def prior_of(model_id: bytes) -> LatentPrior:
    """Return the entropy model with this id. Raises ModelError if there is none."""
    if model_id == tiny_model_id():
        return tiny_prior()
    return load_receiver(_receiver_file(model_id))[0].prior


@cache
def weights_of(model_id: bytes) -> bytes:
    """Return the weights file of the model with this id. Raises ModelError if there is none."""
    return (TINY_MODEL if model_id == tiny_model_id() else _receiver_file(model_id)).read_bytes()


def _receiver_file(model_id: bytes) -> Path:
    return find_receiver(model_id, PAPER_MODEL if model_id == paper_model_id() else None)


@cache
def detail_tables_of(model_id: bytes) -> UInt8[np.ndarray, "plane 16"] | None:
    """Return the tables of detail; None for a model without it. Raises ModelError if there is no model with this id."""
    return bytes_tensor(weights_of(model_id), "detail.tables")


def decode_symbols(stream: Stream) -> list[StageValues]:
    """Decode every stage. Raises BitstreamError if a digest differs."""
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


def decode_detail_symbols(stream: Stream) -> Int32[np.ndarray, "plane view row column"] | None:
    """Decode detail; None if the stream has none. Raises BitstreamError for a payload that is not valid."""
    if stream.detail is None:
        return None
    tables = detail_tables_of(stream.header.model_id)
    assert tables is not None
    return decode_detail(tables, stream.detail.payload, detail_size(stream.header))


def check_detail(stream: Stream) -> None:
    """Raise BitstreamError if the stream has detail that is not valid, or that its model does not have."""
    if stream.detail is not None:
        detail_values(detail_tables_of(stream.header.model_id), stream.detail, stream.header)


def _q8(values: Tensor) -> np.ndarray:
    """Convert to Q8, clipped to +-2^24, because float32 is not exact beyond and layers clip to 16 bits anyway."""
    return (values.permute(0, 2, 3, 1).to(torch.float64) * 256).clamp(-(1 << 24), 1 << 24).to(torch.int64).numpy()


def fingerprint(values: np.ndarray | Sequence[int]) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of values as little-endian int64."""
    return hashlib.sha256(np.asarray(values, dtype="<i8").tobytes()).hexdigest()[:16]


def camera_fingerprint(cameras: PackedCameras) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of near, far, then, per view, fx fy cx cy and rows 1 to 3 of
    camera-to-world, as little-endian float32.
    """
    values = [cameras.near, cameras.far]
    for lens, pose in zip(cameras.intrinsics, cameras.extrinsics, strict=True):
        values += [*lens, *pose]
    return hashlib.sha256(np.array(values, dtype="<f4").tobytes()).hexdigest()[:16]
