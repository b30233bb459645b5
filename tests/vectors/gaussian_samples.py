"""Gaussians of some streams, as reference values for the tolerant part of conformance."""

from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import read_stream
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode
from tests.vectors.paper_model import PAPER_MODEL

PAPER_STREAM = "valid/paper.fcs"  # of the model in vectors/paper
EVERY = 16
FIELDS = 23  # mean, scales, rotation, opacity, harmonics up to degree 1
PAPER_FIELDS = 38  # up to degree 2


def table(gaussians: Gaussians) -> Float[Tensor, "n field"]:
    """Return one row per Gaussian: x y z, scales, quaternion wxyz, opacity, harmonics (coefficient, then rgb).

    Missing harmonics of degree 1 are 0.
    """
    missing = max(0, 4 - gaussians.harmonics.shape[1])
    gaussians = replace(gaussians, harmonics=pad(gaussians.harmonics, (0, 0, 0, missing)))
    fields = (field.reshape(gaussians.count, -1) for field in gaussians.fields())
    return torch.cat(tuple(fields), dim=1)


def has_samples(name: str) -> bool:
    """Return whether a vector has reference Gaussians: scenes of released models, and that of the paper's method."""
    return name.startswith("valid/scene-") or name == PAPER_STREAM


def model_of(name: str) -> Path | None:
    """Return the folder of the model of a vector that has reference Gaussians; None for the released ones."""
    return PAPER_MODEL if name == PAPER_STREAM else None


def scene_samples(data: bytes, model: Path | None = None) -> bytes:
    """Return every sixteenth Gaussian of the stream, as rows of little-endian float32."""
    rows = table(decode(data, background=None, merging=None, model=model).gaussians)[::EVERY].contiguous()
    return rows.numpy().astype("<f4").tobytes()


def read_samples(path: Path) -> Float[Tensor, "n field"]:
    fields = PAPER_FIELDS if path.stem == Path(PAPER_STREAM).stem else FIELDS
    return torch.frombuffer(bytearray(path.read_bytes()), dtype=torch.float32).view(-1, fields)


def like_samples(rows: Float[Tensor, "n field"], samples: Float[Tensor, "m field"]) -> Float[Tensor, "m field"]:
    """Return the row of the Gaussian of each sample: the nearest one at about the same index.

    Indices shift, because Gaussians near the opacity threshold may be emitted on one machine only.
    """
    around = torch.arange(len(samples))[:, None] * EVERY + torch.arange(-EVERY // 2, EVERY // 2 + 1)
    around = around.clamp(0, len(rows) - 1)
    distance = (rows[around, :3] - samples[:, None, :3]).norm(dim=2)
    return rows[around.gather(1, distance.argmin(dim=1, keepdim=True))[:, 0]]


def nearest_depth(data: bytes, rows: Float[Tensor, "n field"]) -> Float[Tensor, " n"]:
    """Return the distance of each Gaussian from the nearest context camera, in scene units."""
    centres = unpack(read_stream(data).cameras).extrinsics[:, :3, 3]
    return torch.cdist(rows[:, :3].double(), centres.double()).min(dim=1).values
