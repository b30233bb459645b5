"""DepthSplat-Base's depth: two scales of matching, from coarse to fine, then a DPT head."""

from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.grid import FEATURES
from fecocodec.sender.extractors.depthsplat_base.dpt_head import FINE_CHANNELS, VIT_CHANNELS, DptHead
from fecocodec.sender.extractors.depthsplat_small.backbone import MIDDLE, OUTPUT, resized, whole_patches
from fecocodec.sender.extractors.depthsplat_small.branches import Branches, Fusion, flat
from fecocodec.sender.extractors.depthsplat_small.cost_volume import NUM_CANDIDATES
from fecocodec.sender.extractors.vision_transformer import normalised

VIT_BLOCKS = (2, 5, 8, 11)  # whose maps are used
_NUM_FINE = NUM_CANDIDATES // 4  # candidates at 1/2
_UPSAMPLER_CHANNELS = 48


@dataclass(frozen=True)
class Maps:
    """Outputs of the branches; item = (batch view).

    appearance: at 1/2, 1/2 and 1/4. multi_view: at 1/4 and 1/2. monocular: of four blocks of the ViT, at 1/8.
    """

    appearance: tuple[Float[Tensor, "item 64 h2 w2"], Float[Tensor, "item 96 h2 w2"], Float[Tensor, "item 128 h4 w4"]]
    multi_view: tuple[Float[Tensor, "item 128 h4 w4"], Float[Tensor, "item 64 h2 w2"]]
    monocular: list[Float[Tensor, "item vit h8 w8"]]


@dataclass(frozen=True)
class Depth:
    """Depth along the optical axis, at full resolution, and the probabilities of the candidates at 1/4 and 1/2."""

    depth: Float[Tensor, "item h w"]
    probabilities: list[Float[Tensor, "item _ _ _"]]


class Pyramid(nn.Module):
    """Features at 1/4 -> (the same, half as many at 1/2)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        finer = nn.Sequential(
            nn.ConvTranspose2d(channels, half, 2, stride=2), nn.GELU(), nn.Conv2d(half, half, 3, padding=1)
        )
        self.stages = nn.ModuleList([nn.Identity(), finer])

    def forward(self, x: Float[Tensor, "item _ h4 w4"]) -> tuple[Tensor, Tensor]:
        return x, self.stages[1](x)


class DepthPredictor(Branches):
    """The branches, their second scale, and the networks that predict depth from them."""

    def __init__(self) -> None:
        super().__init__("public", VIT_CHANNELS)
        self.mv_pyramid, self.mono_pyramid = Pyramid(OUTPUT), Pyramid(VIT_CHANNELS)
        coarse = NUM_CANDIDATES + 2 * OUTPUT + VIT_CHANNELS
        fine = _NUM_FINE + MIDDLE + FINE_CHANNELS + VIT_CHANNELS // 2
        self.regressor = nn.ModuleList([Fusion(coarse), Fusion(fine, FINE_CHANNELS, num_levels=4)])
        self.regressor_residual = nn.ModuleList([nn.Conv2d(coarse, OUTPUT, 1), nn.Conv2d(fine, FINE_CHANNELS, 1)])
        self.depth_head = nn.ModuleList([_head(OUTPUT, NUM_CANDIDATES), _head(FINE_CHANNELS, _NUM_FINE)])
        self.upsampler = DptHead(_UPSAMPLER_CHANNELS, predicts_depth=True)

    def maps(self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> Maps:
        """Run the branches. images: sRGB in [0, 1], sides multiples of 16."""
        views, _, h, w = images.shape[1:]
        pictures = normalised(flat(images))
        appearance = self.backbone.scales(pictures)
        multi_view = flat(self.multi_view(_by_view(appearance[-1], views), cameras))
        of_blocks = self.pretrained.maps(whole_patches(pictures), VIT_BLOCKS)
        return Maps(appearance, self.mv_pyramid(multi_view), [resized(x, (h // 8, w // 8)) for x in of_blocks])

    def monocular(self, maps: Maps) -> tuple[Tensor, Tensor]:
        """Return the last features of the ViT at 1/4 and at 1/2."""
        rows, columns = maps.monocular[-1].shape[-2:]
        return self.mono_pyramid(resized(maps.monocular[-1], (rows * 8 // FEATURES, columns * 8 // FEATURES)))

    def depth(self, maps: Maps, cameras: Cameras) -> Depth:
        """Return the depth of every view, in the unit of the cameras, on which the last correction depends."""
        views = cameras.num_views
        bounds = [(1.0 / bound).repeat_interleave(views).view(-1, 1, 1, 1) for bound in (cameras.far, cameras.near)]
        monocular, probabilities = self.monocular(maps), []
        inverse: Tensor | None = None
        for scale, (fuse, add, head) in enumerate(
            zip(self.regressor, self.regressor_residual, self.depth_head, strict=True)
        ):
            features = maps.multi_view[scale]
            candidates = _candidates(bounds, inverse, features.shape[-2:])
            of_points = rearrange(1.0 / candidates, "(b v) d h w -> b v (h w) d", v=views)
            costs = self.costs(_by_view(features, views), cameras, of_points)
            joined = torch.cat((costs, maps.appearance[-1 - scale], features, monocular[scale]), dim=1)
            probabilities.append(head(fuse(joined, views) + add(joined)).softmax(dim=1))
            inverse = (probabilities[-1] * candidates).sum(dim=1, keepdim=True)
        correction = self.upsampler(maps.monocular, maps.appearance, maps.multi_view, inverse)
        corrected = resized(inverse, correction.shape[-2:]) + correction
        return Depth(1.0 / corrected.clamp(*bounds)[:, 0], probabilities)


def _candidates(bounds: list[Tensor], coarse: Tensor | None, size: tuple[int, int]) -> Float[Tensor, "item _ _ _"]:
    """Return candidate inverse depths: of the whole range, the same for all points, or around a coarse estimate.

    Around it they are half as far apart, and stay in the range. size: of the result, in the second case.
    """
    low, high = bounds
    if coarse is None:
        share = torch.linspace(0.0, 1.0, NUM_CANDIDATES, device=low.device)
    else:
        share = torch.linspace(0.0, 1.0, _NUM_FINE, device=low.device)
        step = (high - low) / (NUM_CANDIDATES - 1) / 2
        around = resized(coarse, size)
        low = torch.maximum(around - step * (_NUM_FINE // 2), low)
        high = torch.minimum(around + step * (_NUM_FINE // 2 - 1), high)
    return low + share[:, None, None] * (high - low)


def _head(channels: int, num_candidates: int) -> nn.Sequential:
    """Return the layers that map fused features to a score of each candidate."""
    first = nn.Conv2d(channels, 2 * channels, 3, padding=1, padding_mode="replicate")
    return nn.Sequential(
        first, nn.GELU(), nn.Conv2d(2 * channels, num_candidates, 3, padding=1, padding_mode="replicate")
    )


def _by_view(x: Float[Tensor, "item channel h w"], views: int) -> Float[Tensor, "batch view channel h w"]:
    return rearrange(x, "(b v) c h w -> b v c h w", v=views)
