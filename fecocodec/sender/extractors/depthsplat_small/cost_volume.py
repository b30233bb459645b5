"""Plane-sweep matching of the multi-view features (Chen et al., "MVSplat", 2024, equation 2).

The score of a candidate is the dot product of the features at a position with those of a source view at the projection
of the candidate's point, divided by the square root of the number of channels; mean over the source views. Points
outside a source contribute 0.
"""

from collections.abc import Callable

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, image_positions, pixel_rays
from fecocodec.sender.extractors.plane_sweep import correlate

NUM_CANDIDATES = 128
_SMALLEST_DEPTH = 1e-3  # in the source camera, scene units

Depths = Float[Tensor, "... candidate"]
PositionsInSource = Float[Tensor, "point candidate 2"]

Positions = Callable[[Cameras, int, int, Depths, int, int], Tensor]
"""(cameras of a scene, view, source, candidate depths, height, width) -> normalised positions in the source.

Candidates are those of all points, or each point has its own row of them."""


def source_views(cameras: Cameras) -> Int[Tensor, "batch view count"]:
    """Return the sources of each view: all others of up to three views, else the two nearest; of one view, itself."""
    batch, views = cameras.extrinsics.shape[:2]
    if views > 3:
        return nearest_views(cameras, 2)
    others = [[other for other in range(views) if other != view] or [view] for view in range(views)]
    return torch.tensor(others, device=cameras.extrinsics.device).expand(batch, -1, -1)


def nearest_views(cameras: Cameras, count: int) -> Int[Tensor, "batch view count"]:
    """Return, for every view, the `count` other views (all, if there are fewer) with the nearest camera centres."""
    centres = cameras.extrinsics[..., :3, 3]
    distances = torch.cdist(centres, centres)
    distances.diagonal(dim1=-2, dim2=-1).fill_(float("inf"))
    return distances.topk(min(count, cameras.num_views - 1), dim=-1, largest=False).indices


def candidate_depths(cameras: Cameras) -> Float[Tensor, "batch candidate"]:
    """Return candidate depths, uniform in inverse depth from far to near, in scene units."""
    share = torch.linspace(0.0, 1.0, NUM_CANDIDATES, device=cameras.near.device)
    farthest, nearest = 1.0 / cameras.far[:, None], 1.0 / cameras.near[:, None]
    return 1.0 / (farthest + share * (nearest - farthest))


def exact_positions(
    cameras: Cameras, view: int, source: int, depths: Depths, height: int, width: int
) -> PositionsInSource:
    """Project the points at each depth along the ray of each pixel centre into the source, with its own intrinsics."""
    rays = pixel_rays(cameras.select([view]), height, width)[0]
    return _projected(cameras, view, source, rays.flatten(0, 1), depths)


def public_positions(
    cameras: Cameras, view: int, source: int, depths: Depths, height: int, width: int
) -> PositionsInSource:
    """Compute the positions as the public code does; its checkpoints were trained with them.

    They differ from `exact_positions` in one way: pixel i is at position i instead of i + 0.5. The public code projects
    with the intrinsics of the view; here they are the source's own, which is the same for the equal intrinsics of its
    data sets, and right for others.
    """
    corner = pixel_rays(cameras.select([view]), height, width)[0]
    focal = cameras.intrinsics[view].diagonal()[:2] * cameras.intrinsics.new_tensor([width, height])
    shifted = corner - torch.cat((0.5 / focal, focal.new_zeros(1)))
    uv = _projected(cameras, view, source, shifted.flatten(0, 1), depths)
    return uv + 0.5 / uv.new_tensor([width, height])


def _projected(
    cameras: Cameras, view: int, source: int, rays: Float[Tensor, "point 3"], depths: Depths
) -> PositionsInSource:
    """Project the points at each depth along rays of the view into the source, in normalised coordinates."""
    to_source = cameras.world_to_camera[source] @ cameras.extrinsics[view]
    points = (rays @ to_source[:3, :3].T)[:, None] * depths[..., None] + to_source[:3, 3]
    return image_positions(points.flatten(0, 1), cameras.intrinsics[source], _SMALLEST_DEPTH).view(len(rays), -1, 2)


def cost_volume(
    features: Float[Tensor, "batch view channel h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    positions: Positions,
    depths: Float[Tensor, "batch view _ candidate"],
) -> Float[Tensor, "batch view candidate h w"]:
    """Return the scores of all candidates; higher is better. Views are processed one by one to limit memory.

    sources: see `source_views`. positions: `exact_positions` or `public_positions`. depths: candidates of each
    point, in row-major order, or one row of them for all points of a view, such as `candidate_depths`.
    """
    batch, views, channels, h, w = features.shape
    volumes = []
    for scene in range(batch):
        of_scene = cameras.scene(scene)
        for view in range(views):
            chosen = sources[scene, view]
            with torch.no_grad():
                grids = [positions(of_scene, view, source, depths[scene, view], h, w) for source in chosen.tolist()]
            cost = correlate(features[scene, view], features[scene, chosen], torch.stack(grids))
            volumes.append(cost / channels**0.5)
    return rearrange(torch.stack(volumes), "(b v) (h w) d -> b v d h w", b=batch, h=h)
