"""Conversion of cameras between tensors and the container. The sender, too, computes from the unpacked cameras."""

import torch

from fecocodec.container import PackedCameras
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussian_arrays import SceneCameras

LARGEST_SKEW = 1e-6  # in image widths; smaller values are rounding errors


def pack(cameras: Cameras) -> PackedCameras:
    """Convert the cameras of one scene (no batch axis) to float32 of the container. Raises InputError for skew."""
    intrinsics = cameras.intrinsics
    for number, skew in enumerate(intrinsics[:, 0, 1].tolist(), start=1):
        if not abs(skew) <= LARGEST_SKEW:
            raise InputError(
                f"camera {number}: its intrinsics have a skew of {skew}; undistort the image to a pinhole's."
            )
    entries = (intrinsics[:, 0, 0], intrinsics[:, 1, 1], intrinsics[:, 0, 2], intrinsics[:, 1, 2])
    return PackedCameras(
        extrinsics=tuple(map(tuple, cameras.extrinsics[:, :3].float().flatten(1).tolist())),
        intrinsics=tuple(map(tuple, torch.stack(entries, dim=1).float().tolist())),
        near=float(cameras.near.float()),
        far=float(cameras.far.float()),
    )


def unpack(packed: PackedCameras) -> Cameras:
    """Invert `pack` exactly; returns float32 tensors on the CPU."""
    return Cameras.of(SceneCameras.of_rows(packed.extrinsics, packed.intrinsics, packed.near, packed.far))
