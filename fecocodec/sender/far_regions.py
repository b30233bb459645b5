"""Plain regions that other views see through, such as the sky around a statue: they lie far away.

Matching cannot tell the depth of a region without texture; it gets that of what is beside it. From another side it then
stands as fog before the object. A plain pixel is seen through where another view shows a textured, confirmed surface
behind it, of another colour. Such pixels, and the plain pixels connected to them, get the far bound, which must lie
behind the cameras on the other side: otherwise the region would stand before them.
"""

from copy import copy
from dataclasses import replace

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, depth_from_relative_disparity, pixel_rays
from fecocodec.sender.extractors.protocol import MatchedDepth
from fecocodec.sender.fading import LEAST_VIEWS
from fecocodec.sender.scene_encoder import SceneEncoder

# Chosen on training captures, 12 coded views each (docs/what_we_learned.md, More views).
LEAST_SHARE = 0.06  # of all pixels that are seen through; between 0.05 and this, two of three captures lost a little
PLAIN = 0.03  # standard deviation of grey, in [0, 1], below which a pixel is plain
WINDOW = 5  # side of the window of this deviation, in pixels at 1/4 resolution
LEAD = 0.08  # logarithm of the ratio of depths of a surface and of what is before it
DIFFERENCE = 0.06  # squared distance of their sRGB colours in [0, 1]
LEAST_TEXTURED, LEAST_CONFIRMED = 0.6, 0.5  # share of textured pixels, and consistency, of the surface
BEYOND = 1.5  # far bound in depths of the farthest camera that is before another one


def far_factor(cameras: Cameras) -> float:
    """Return the factor, at least 1, of the far bound with which it lies behind all cameras that are before others."""
    depth_of_cameras = cameras.project(cameras.extrinsics[:, :3, 3]).depth
    return max(1.0, BEYOND * float(depth_of_cameras.max() / cameras.far))


def with_far_regions(encoder: SceneEncoder) -> SceneEncoder:
    """Return an encoder whose matched depth is the far bound where others see through plain regions."""
    changed, matching = copy(encoder), encoder.matching
    changed.matching = replace(matching, depth=matching.depth.moved_far(seen_through(encoder)[:, None]))
    return changed


@torch.no_grad()
def seen_through(encoder: SceneEncoder) -> Bool[Tensor, "view h4 w4"]:
    """Return the plain pixels that are seen through, and those connected to them; no pixel if they are few.

    No pixel is found in cut-outs, or with fewer than LEAST_VIEWS views, of which hardly any face each other.
    """
    depth = encoder.matching.depth
    none = torch.zeros_like(depth.relative_disparity[:, 0], dtype=torch.bool)
    is_tried = encoder.codec.receiver.config.kind.has_rules and encoder.num_views >= LEAST_VIEWS
    if not is_tried or encoder.cut_out is not None:
        return none
    size = (none.shape[-2], none.shape[-1])
    colour = F.interpolate(encoder.images[0], size, mode="area")
    is_plain = _deviation(colour) < PLAIN
    if encoder.ignored is not None:
        is_plain &= F.interpolate(encoder.ignored[:, None].float(), size, mode="area")[:, 0] == 0.0
    found = is_plain & _is_before_another(depth, colour, ~is_plain, encoder.cameras.scene(0))
    return _connected(found, is_plain) if float(found.float().mean()) >= LEAST_SHARE else none


def _deviation(colour: Float[Tensor, "view 3 h w"]) -> Float[Tensor, "view h w"]:
    """Return the standard deviation of grey around each pixel."""
    grey, margin = colour.mean(dim=1, keepdim=True), WINDOW // 2
    padded = F.pad(torch.cat((grey, grey.square()), dim=1), (margin,) * 4, mode="replicate")
    mean, of_squares = F.avg_pool2d(padded, WINDOW, stride=1).unbind(dim=1)
    return (of_squares - mean.square()).clamp_min(0.0).sqrt()


def _is_before_another(
    matched: MatchedDepth,
    colour: Float[Tensor, "view 3 h w"],
    is_textured: Bool[Tensor, "view h w"],
    cameras: Cameras,
) -> Bool[Tensor, "view h w"]:
    """Return the pixels before a textured, confirmed surface of another view that differs in colour."""
    depth = depth_from_relative_disparity(matched.blended[None, :, 0], cameras.as_batch())[0]
    points = camera_to_world_points(cameras, pixel_rays(cameras, *depth.shape[-2:]) * depth[..., None])
    shown = torch.cat((colour, 1.0 / depth[:, None], is_textured[:, None].float(), matched.consistency), dim=1)
    found = torch.zeros_like(is_textured)
    for other, surface in enumerate(shown):
        uv, there, is_visible = (field[0] for field in cameras.select([other]).project(points))
        grid, planes = 2.0 * uv.clamp(-1, 2) - 1.0, surface.expand(len(points), -1, -1, -1)
        sampled = F.grid_sample(planes, grid, padding_mode="border", align_corners=False)
        lead = -(sampled[:, 3] * there).clamp_min(1e-6).log()
        is_surface = (sampled[:, 4] > LEAST_TEXTURED) & (sampled[:, 5] > LEAST_CONFIRMED)
        differs = (sampled[:, :3] - colour).square().sum(dim=1) > DIFFERENCE
        is_before = is_visible & is_surface & differs & (lead > LEAD)
        is_before[other] = False
        found |= is_before
    return found


def _connected(start: Bool[Tensor, "view h w"], allowed: Bool[Tensor, "view h w"]) -> Bool[Tensor, "view h w"]:
    """Return the allowed pixels that are connected to those of the start by allowed pixels, also diagonally."""
    reached, count = start, -1
    while int(reached.sum()) != count:
        count = int(reached.sum())
        grown = F.max_pool2d(rearrange(reached, "v h w -> v 1 h w").float(), 3, stride=1, padding=1)[:, 0]
        reached = (grown > 0.0) & allowed
    return reached
