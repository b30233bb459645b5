"""Plane-sweep matching of the multi-view features (Chen et al., "MVSplat", 2024, equation 2).

A candidate's cost is the dot product of a position's features with those of the source view where the candidate's
point lies, over the square root of the channels, mean over source views. Points outside a source count as 0.
"""

from collections.abc import Callable

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, pixel_rays
from fecocodec.sender.extractors.plane_sweep import correlate, nearest_views

NUM_CANDIDATES = 128
_SMALLEST_DEPTH = 1e-3  # in the source camera, scene units
_FARTHEST = 4.0  # image sizes from the middle; beyond it a position is outside in any case

Positions = Callable[[Cameras, int, int, Float[Tensor, " candidate"], int, int], Tensor]
"""(cameras of a scene, view, source, candidates' depths, height, width) -> normalised positions in the source."""


def source_views(cameras: Cameras) -> Int[Tensor, "batch view count"]:
    """The views that each view is matched with: all others of up to three, else the two nearest by camera centre.

    A single view is its own source, for there is nothing else to attend to.
    """
    batch, views = cameras.extrinsics.shape[:2]
    if views > 3:
        return nearest_views(cameras, 2)
    others = [[other for other in range(views) if other != view] or [view] for view in range(views)]
    return torch.tensor(others, device=cameras.extrinsics.device).expand(batch, -1, -1)


def candidate_depths(cameras: Cameras) -> Float[Tensor, "batch candidate"]:
    """Depths uniform in inverse depth, from far to near, in scene units."""
    share = torch.linspace(0.0, 1.0, NUM_CANDIDATES, device=cameras.near.device)
    farthest, nearest = 1.0 / cameras.far[:, None], 1.0 / cameras.near[:, None]
    return 1.0 / (farthest + share * (nearest - farthest))


def exact_positions(
    cameras: Cameras, view: int, source: int, depths: Float[Tensor, " candidate"], height: int, width: int
) -> Float[Tensor, "point candidate 2"]:
    """Where the points behind each pixel centre lie in the source, by each camera's own intrinsics."""
    rays = pixel_rays(cameras.select([view]), height, width)[0]
    return _projected(cameras, view, source, rays.flatten(0, 1), depths, cameras.intrinsics[source])


def public_positions(
    cameras: Cameras, view: int, source: int, depths: Float[Tensor, " candidate"], height: int, width: int
) -> Float[Tensor, "point candidate 2"]:
    """As the public code computes them, and its checkpoints were trained with.

    The view's intrinsics serve for the source too, and the pixel of index i stands at i instead of i + 0.5 in
    intrinsics that were merely divided by the downscaling.
    """
    corner = pixel_rays(cameras.select([view]), height, width)[0]
    focal = cameras.intrinsics[view].diagonal()[:2] * cameras.intrinsics.new_tensor([width, height])
    shifted = corner - torch.cat((0.5 / focal, focal.new_zeros(1)))
    uv = _projected(cameras, view, source, shifted.flatten(0, 1), depths, cameras.intrinsics[view])
    return uv + 0.5 / uv.new_tensor([width, height])


def _projected(
    cameras: Cameras,
    view: int,
    source: int,
    rays: Float[Tensor, "point 3"],
    depths: Float[Tensor, " candidate"],
    intrinsics: Float[Tensor, "3 3"],
) -> Float[Tensor, "point candidate 2"]:
    """Rays of the view, taken to each depth and projected into the source, normalised by its size."""
    to_source = cameras.world_to_camera[source] @ cameras.extrinsics[view]
    points = (rays @ to_source[:3, :3].T)[:, None] * depths[:, None] + to_source[:3, 3]
    projected = points @ intrinsics.T
    uv = projected[..., :2] / projected[..., 2:].clamp_min(_SMALLEST_DEPTH)
    return uv.clamp(-_FARTHEST, _FARTHEST)


def cost_volume(
    features: Float[Tensor, "batch view channel h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    positions: Positions,
) -> Float[Tensor, "batch view candidate h w"]:
    """Costs of all candidates; memory is bounded by working on one view of one scene, in chunks of its positions."""
    batch, views, channels, h, w = features.shape
    depths = candidate_depths(cameras)
    volumes = []
    for scene in range(batch):
        of_scene = cameras.scene(scene)
        for view in range(views):
            chosen = sources[scene, view]
            with torch.no_grad():
                places = [positions(of_scene, view, source, depths[scene], h, w) for source in chosen.tolist()]
            cost = correlate(features[scene, view], features[scene, chosen], torch.stack(places))
            volumes.append(cost / channels**0.5)
    return rearrange(torch.stack(volumes), "(b v) (h w) d -> b v d h w", b=batch, h=h)
