"""Merging of similar neighbouring Gaussians, for tensors."""

import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.merging.merge import MergingConfig as MergingConfig
from fecocodec.merging.merge import merged_fields


def merged(
    gaussians: Gaussians, is_present: Bool[Tensor, " n"], grid: tuple[int, int], cameras: Cameras, config: MergingConfig
) -> Gaussians:
    """Return `merged_fields`, computed on the CPU. cameras: of the views, in the frame of the Gaussians."""
    arrays = tuple(field.cpu().numpy() for field in gaussians.fields())
    poses = (cameras.extrinsics.cpu().numpy(), cameras.intrinsics.cpu().numpy())
    found = merged_fields(arrays, is_present.cpu().numpy(), grid, *poses, config)
    return Gaussians(*(torch.from_numpy(field) for field in found)).to(gaussians.means.device)
