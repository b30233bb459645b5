"""Overlap of the context views after matching, and warnings about views that do not fit the others.

The limits were chosen on scenes that weights are trained on: of pairs with overlap, 15% or more of the pixels are
confirmed; of pairs whose second photograph was replaced by that of another scene, fewer than 2%. Views of two
sides of an object that the cameras put at one place reached 3.2% (tt_truck), views of one room 5.6% or more.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, depth_from_relative_disparity, pixel_rays
from fecocodec.sender.extractors.cross_view_consistency import TOLERANCE, consistency_with
from fecocodec.sender.scene import Guides

LEAST_SHARED, LEAST_CONFIRMED = 0.1, 0.02  # shares of a view's pixels below which `overlap_warnings` names the view
LEAST_LINK = 0.04  # confirmed share of the pixels of one of two views, below which they do not count as connected
DISPARITY_DIFFERENCE = 0.01  # largest difference of relative disparity, of consistent depths
COLOUR_DIFFERENCE = 0.1  # largest mean absolute difference of sRGB, of similar colours
LEAST_CORRELATION = 0.6  # of windows of similar texture
_WINDOW = 5  # side of the window, in pixels at 1/4 resolution
_LEAST_COVARIANCE = 1e-4  # sum over the colours; uniform windows correlate


@dataclass(frozen=True)
class ViewOverlap:
    """Overlap of the pixels of view a (row) with view or guide b (column), as shares in [0, 1]; 0 on the diagonal.

    shared: pixels whose matched point projects into the image of b. confirmed: those among them whose depth, colour and
    texture agree with b; of guides, whose depth is not known, colour and texture count.
    """

    shared: Float[Tensor, "view other"]
    confirmed: Float[Tensor, "view other"]

    @property
    def mutual(self) -> Float[Tensor, "view view"]:
        """Shares of two views' pixels that confirm each other: the larger of the two."""
        of_views = self.confirmed[:, : len(self.confirmed)]
        return torch.maximum(of_views, of_views.T)

    @property
    def most_confirmed(self) -> Float[Tensor, " view"]:
        """Share of each view's pixels that the view or guide which fits it best confirms."""
        of_guides = self.confirmed[:, len(self.confirmed) :]
        return torch.cat((self.mutual, of_guides), dim=1).amax(dim=1)


@torch.no_grad()
def view_overlap(
    images: Float[Tensor, "view 3 h w"],
    relative_disparity: Float[Tensor, "view 1 h4 w4"],
    cameras: Cameras,
    guides: Guides | None = None,
    ignored: Bool[Tensor, "view h w"] | None = None,
) -> ViewOverlap:
    """Measure the overlap of all pairs of views of one scene, and of the views with the guides.

    images: sRGB in [0, 1]. relative_disparity: in [0, 1], of every view by matching (`MatchedDepth`). cameras: of the
    scene, normalised. ignored: pixels of the views that do not count; None if all do.
    """
    relative = rearrange(relative_disparity, "v 1 h w -> v h w")
    colours = F.interpolate(images, relative.shape[-2:], mode="area")
    depth = depth_from_relative_disparity(relative[None], cameras.as_batch())[0]
    points = camera_to_world_points(cameras, pixel_rays(cameras, *relative.shape[-2:]) * depth[..., None])
    kept = torch.ones_like(relative)
    if ignored is not None:
        kept = 1 - F.interpolate(ignored[:, None].float(), relative.shape[-2:], mode="area")[:, 0]
    count, every, colours_of_all = len(images), cameras, colours
    if guides is not None:
        of_guides = F.interpolate(guides.images, relative.shape[-2:], mode="area")
        every, colours_of_all = cameras.joined(guides.cameras), torch.cat((colours, of_guides))
    shared, confirmed = torch.zeros(2, count, len(colours_of_all))
    for view in range(count):
        for other in (other for other in range(len(colours_of_all)) if other != view):
            projected = every.select([other]).project(points[view])
            is_there = projected.is_visible[0]
            if other < count:
                consistency = consistency_with(relative[other], points[view], cameras, other)
                is_there = consistency > math.exp(-DISPARITY_DIFFERENCE / TOLERANCE)
            is_confirmed = is_there & _looks_alike(colours[view], colours_of_all[other], projected.uv[0])
            shared[view, other] = _share(projected.is_visible[0], kept[view])
            confirmed[view, other] = _share(is_confirmed, kept[view])
    return ViewOverlap(shared, confirmed)


def _share(found: Bool[Tensor, "h w"], kept: Float[Tensor, "h w"]) -> Float[Tensor, ""]:
    return (found * kept).sum() / kept.sum().clamp_min(1e-6)


def overlap_warnings(overlap: ViewOverlap, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return one sentence per view that hardly overlaps with any other, or that no other view confirms.

    If the other views fall into parts that do not confirm each other, such as two sides of an object, one more sentence
    lists the parts.
    """
    count = len(names)
    if overlap.shared.shape[1] == 1:
        return ()
    of_guides, mutual = overlap.confirmed[:, count:], overlap.mutual
    shared, confirmed = overlap.shared.amax(dim=1), overlap.most_confirmed
    common = torch.minimum(of_guides[:, None], of_guides[None]).amax(dim=-1) if of_guides.numel() else mutual
    mutual = torch.maximum(mutual, common)  # a guide that confirms two views connects them
    warnings = []
    for name, share, certain in zip(names, shared.tolist(), confirmed.tolist(), strict=True):
        if share < LEAST_SHARED:
            warnings.append(
                f"{name} shares {100 * share:.1f}% of its pixels with the view that overlaps it most; choose a view "
                "between the two, or leave it out by `views`."
            )
        elif certain < LEAST_CONFIRMED:
            warnings.append(
                f"the depth of only {100 * certain:.1f}% of the pixels of {name} is confirmed by another view; check "
                "its camera, choose views that are closer together, or leave it out by `views`."
            )
    fitting = (shared >= LEAST_SHARED) & (confirmed >= LEAST_CONFIRMED)
    parts = _parts(mutual[fitting][:, fitting], [name for name, fits in zip(names, fitting, strict=True) if fits])
    if len(parts) > 1:
        warnings.append(
            f"the views fall into {len(parts)} parts that hardly confirm each other: {'; '.join(parts)}; check "
            "their cameras, choose `views` that connect the parts, or encode each part to a file of its own."
        )
    return tuple(warnings)


def _parts(confirmed: Float[Tensor, "view view"], names: list[str]) -> list[str]:
    """Return the names of the views of each connected part. Two views are connected from LEAST_LINK on."""
    links = (confirmed >= LEAST_LINK).float() + torch.eye(len(names))
    is_reached = torch.linalg.matrix_power(links, len(names)) > 0
    parts = dict.fromkeys(tuple(row) for row in is_reached.tolist())
    return [", ".join(name for name, is_own in zip(names, part, strict=True) if is_own) for part in parts]


def _looks_alike(
    own: Float[Tensor, "3 h w"], other: Float[Tensor, "3 h w"], uv: Float[Tensor, "h w 2"]
) -> Bool[Tensor, "h w"]:
    """Return where colour and texture of an image agree with those at the positions `uv` of another one."""
    grid = 2.0 * uv.clamp(-1, 2)[None] - 1.0
    found = F.grid_sample(other[None], grid, padding_mode="border", align_corners=False)[0]
    return ((own - found).abs().mean(dim=0) < COLOUR_DIFFERENCE) & (_correlation(own, found) > LEAST_CORRELATION)


def _correlation(first: Float[Tensor, "3 h w"], second: Float[Tensor, "3 h w"]) -> Float[Tensor, "h w"]:
    """Return the normalised cross-correlation of windows, over all colours."""
    mean_first, mean_second = _mean(first), _mean(second)
    covariance = (_mean(first * second) - mean_first * mean_second).sum(dim=0)
    variances = [
        (_mean(image.square()) - mean.square()).sum(dim=0).clamp_min(0)
        for image, mean in ((first, mean_first), (second, mean_second))
    ]
    floor = _LEAST_COVARIANCE
    return (covariance + floor) / ((variances[0] + floor) * (variances[1] + floor)).sqrt()


def _mean(image: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 h w"]:
    """Return the mean over the part of each window inside the image."""
    return F.avg_pool2d(image[None], _WINDOW, stride=1, padding=_WINDOW // 2, count_include_pad=False)[0]
