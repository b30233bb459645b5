"""Plane-sweep matching: correlate the features of each view with those of other views at candidate depths."""

import numpy as np
import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Float32, Int, Int64
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, depth_from_relative_disparity, image_positions, pixel_rays
from fecocodec.geometry.frustum_overlap import LEAST_BASELINE, NEIGHBOUR_OVERLAP, covisibility_estimate
from fecocodec.geometry.gaussian_arrays import SceneCameras
from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.threads import run_in_ranges

MOST_CORRELATED = 2**14  # maximum number of positions of a view for correlating all pairs
MAX_PRODUCTS = 2**24  # maximum number of products in memory


def source_views(cameras: Cameras, count: int) -> Int[Tensor, "batch view count"]:
    """Return, for every view, the `count` other views (all, if there are fewer) against which it is matched.

    They are the nearest ones that overlap with it and have parallax. Where fewer do, those that overlap most follow: in
    a room, the nearest camera may look at the opposite wall. Nearest first.
    """
    sources = [_sources_of(cameras.scene(scene).arrays(), count) for scene in range(len(cameras.extrinsics))]
    return torch.from_numpy(np.stack(sources)).to(cameras.extrinsics.device)


def _sources_of(cameras: SceneCameras, count: int) -> Int64[np.ndarray, "view count"]:
    """Return `source_views` of one scene."""
    near, far, centres = float(cameras.near), float(cameras.far), cameras.extrinsics[:, :3, 3]
    overlap = covisibility_estimate(cameras.extrinsics, cameras.intrinsics, near, far)
    distance = np.linalg.norm(centres[:, None] - centres, axis=-1)
    parallax = distance * (1 / near + 1 / far) / 2
    is_neighbour = (overlap >= NEIGHBOUR_OVERLAP) & (parallax >= LEAST_BASELINE)
    rank = np.where(is_neighbour, distance, -overlap * np.minimum(parallax, LEAST_BASELINE))
    chosen = []
    for view, order in enumerate(np.lexsort((rank, ~is_neighbour))):
        others = order[order != view][:count]
        chosen.append(others[np.argsort(distance[view, others], kind="stable")])
    return np.stack(chosen)


def cost_volume(
    features: Float[Tensor, "batch view channel h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    num_candidates: int,
) -> Float[Tensor, "batch view candidate h w"]:
    """Return the plane-sweep cost volume (Chen et al., "MVSplat", 2024, equation 2).

    An entry is the dot product of the features of a view with those of a source view, sampled bilinearly at the
    candidate's projection; mean over the source views. A source that does not see the point contributes zero; without
    sources the volume is zero. Candidates are uniform in inverse depth from 1/far to 1/near. features: of unit length
    over channels. sources: indices of the source views of each view.
    """
    batch, views, _, height, width = features.shape
    relative = torch.linspace(0.0, 1.0, num_candidates, device=features.device)
    depth = depth_from_relative_disparity(relative[None, None, :, None].expand(batch, 1, -1, 1), cameras)[:, 0]
    rays = rearrange(pixel_rays(cameras, height, width), "b v h w xyz -> b v (h w) xyz")
    volumes = []
    for scene in range(batch):
        world_to_camera = cameras.world_to_camera[scene]
        for view in range(views):
            to_source = world_to_camera[sources[scene, view]] @ cameras.extrinsics[scene, view]
            turned = rays[scene, view] @ to_source[:, :3, :3].transpose(-1, -2)
            points = turned[:, :, None] * depth[scene] + to_source[:, None, None, :3, 3]
            positions = image_positions(points.flatten(1, 2), cameras.intrinsics[scene, sources[scene, view]])
            grid = positions.view(*points.shape[:3], 2)
            volumes.append(correlate(features[scene, view], features[scene, sources[scene, view]], grid))
    return rearrange(torch.stack(volumes), "(b v) (h w) d -> b v d h w", b=batch, h=height)


def correlate(
    reference: Float[Tensor, "channel h w"],
    sources: Float[Tensor, "source channel h w"],
    grid: Float[Tensor, "source point candidate 2"],
) -> Float[Tensor, "point candidate"]:
    """Correlate each reference position with the sources at the positions of its candidates; mean over sources.

    grid: normalised positions (u, v) in each source. On a CPU without gradients, a kernel computes only the products
    that are needed. Otherwise all pairs of positions are correlated in one matrix product, and each candidate picks
    four entries; above MOST_CORRELATED positions, features are sampled instead.
    """
    height, width = reference.shape[-2:]
    queries = rearrange(reference, "c h w -> (h w) c")
    needs_gradients = torch.is_grad_enabled() and (reference.requires_grad or sources.requires_grad)
    if reference.device.type == "cpu" and not needs_gradients:
        return _without_gradient(queries, sources, grid).to(reference.dtype)
    pick = from_all_pairs if height * width <= MOST_CORRELATED else from_sampled_rows
    total = queries.new_zeros(grid.shape[1:3])
    for source, positions in zip(sources, grid, strict=True):
        keys = rearrange(source, "c h w -> c (h w)")
        index, weight = _bilinear(positions, height, width)
        total = total + pick(queries, keys, index, weight)
    return total / max(1, len(sources))


def _without_gradient(
    queries: Float[Tensor, "point channel"],
    sources: Float[Tensor, "source channel h w"],
    grid: Float[Tensor, "source point candidate 2"],
) -> Float[Tensor, "point candidate"]:
    """Compute only the required products, with a compiled kernel."""
    total = np.zeros(grid.shape[1:3], np.float32)
    for source, positions in zip(sources, grid, strict=True):
        arrays = [_array(x) for x in (queries, rearrange(source, "c h w -> h w c"), positions)]
        run_in_ranges(_add_correlations, len(total), *arrays, total)
    return torch.from_numpy(total) / max(1, len(sources))


def from_all_pairs(
    queries: Float[Tensor, "point channel"],
    keys: Float[Tensor, "channel point"],
    index: Int[Tensor, "point candidate 4"],
    weight: Float[Tensor, "point candidate 4"],
    max_products: int = MAX_PRODUCTS,
) -> Float[Tensor, "point candidate"]:
    """Compute the products of all pairs, and interpolate four for each candidate. Fastest for few positions."""
    chunk = max(1, max_products // keys.shape[1])
    parts = zip(queries.split(chunk), index.split(chunk), weight.split(chunk), strict=True)
    return torch.cat([((q @ keys).gather(1, i.flatten(1)).view_as(w) * w).sum(dim=-1) for q, i, w in parts])


def from_sampled_rows(
    queries: Float[Tensor, "point channel"],
    keys: Float[Tensor, "channel point"],
    index: Int[Tensor, "point candidate 4"],
    weight: Float[Tensor, "point candidate 4"],
    max_products: int = MAX_PRODUCTS,
) -> Float[Tensor, "point candidate"]:
    """Sample features at each candidate, then multiply. Cost is linear in the number of positions."""
    rows = keys.T.contiguous()
    chunk = max(1, max_products // (index.shape[1] * rows.shape[1]))
    parts = zip(queries.split(chunk), index.split(chunk), weight.split(chunk), strict=True)
    picked = []
    for query, corners, share in parts:
        sampled = F.embedding_bag(corners.flatten(0, 1), rows, per_sample_weights=share.flatten(0, 1), mode="sum")
        picked.append((sampled.unflatten(0, (len(query), -1)) @ query[..., None])[..., 0])
    return torch.cat(picked)


def _array(tensor: Float[Tensor, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    return tensor.detach().float().contiguous().numpy()


@compiled
def _add_correlations(start, stop, queries, source, positions, total):  # type: ignore[no-untyped-def]
    """Add the correlation of points start to stop - 1 with bilinearly sampled features of the source to `total`."""
    height, width, channels = source.shape
    for point in range(start, stop):
        for candidate in range(positions.shape[1]):
            x = positions[point, candidate, 0] * np.float32(width) - np.float32(0.5)
            y = positions[point, candidate, 1] * np.float32(height) - np.float32(0.5)
            if not (-1 < x < width and -1 < y < height):
                continue
            left, top = int(np.floor(x)), int(np.floor(y))
            right, down = x - np.float32(left), y - np.float32(top)
            west, north = max(left, 0), max(top, 0)
            east, south = min(left + 1, width - 1), min(top + 1, height - 1)
            of_west = np.float32(1) - right if left >= 0 else np.float32(0)
            of_north = np.float32(1) - down if top >= 0 else np.float32(0)
            of_east = right if left + 1 < width else np.float32(0)
            of_south = down if top + 1 < height else np.float32(0)
            product = np.float32(0)
            for channel in range(channels):
                above = of_west * source[north, west, channel] + of_east * source[north, east, channel]
                below = of_west * source[south, west, channel] + of_east * source[south, east, channel]
                product += queries[point, channel] * (of_north * above + of_south * below)
            total[point, candidate] += product


@torch.no_grad()
def _bilinear(
    positions: Float[Tensor, "point candidate 2"], height: int, width: int
) -> tuple[Int[Tensor, "point candidate 4"], Float[Tensor, "point candidate 4"]]:
    """Return flat indices and bilinear weights of the four pixels around each position; weight 0 outside the image."""
    size = positions.new_tensor([width, height])
    corner = positions * size - 0.5
    first = corner.floor()
    fraction = corner - first
    index, weight = [], []
    for right in (0.0, 1.0):
        for down in (0.0, 1.0):
            step = positions.new_tensor([right, down])
            pixel = first + step
            inside = ((pixel >= 0) & (pixel < size)).all(dim=-1)
            share = (1.0 - step - fraction).abs().prod(dim=-1)
            pixel = torch.minimum(pixel.clamp_min(0), size - 1).long()
            index.append(pixel[..., 1] * width + pixel[..., 0])
            weight.append(share * inside)
    return torch.stack(index, dim=-1), torch.stack(weight, dim=-1)
