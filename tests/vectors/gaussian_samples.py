"""Gaussians of a released model's scene, as reference values for the tolerant part of conformance."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import read_stream
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode

EVERY = 16
FIELDS = 14  # mean, scales, rotation, opacity, harmonics


def table(gaussians: Gaussians) -> Float[Tensor, "n 14"]:
    """One Gaussian a row: x y z, three scales, quaternion wxyz, opacity, three harmonics."""
    fields = (field.reshape(gaussians.count, -1) for field in gaussians.fields())
    return torch.cat(tuple(fields), dim=1)


def scene_samples(data: bytes) -> bytes:
    """Every sixteenth Gaussian of the whole stream, its rows as little-endian float32."""
    rows = table(decode(data))[::EVERY].contiguous()
    return rows.numpy().astype("<f4").tobytes()


def read_samples(path: Path) -> Float[Tensor, "n 14"]:
    return torch.frombuffer(bytearray(path.read_bytes()), dtype=torch.float32).view(-1, FIELDS)


def nearest_depth(data: bytes, rows: Float[Tensor, "n 14"]) -> Float[Tensor, " n"]:
    """Distance of each Gaussian from the nearest context camera, in scene units."""
    centres = unpack(read_stream(data).cameras).extrinsics[:, :3, 3]
    return torch.cdist(rows[:, :3].double(), centres.double()).min(dim=1).values
