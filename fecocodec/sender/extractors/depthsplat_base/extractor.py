"""DepthSplat-Base as a frozen extractor of the adapter: posed photographs -> features at full resolution."""

import hashlib
from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_base.dpt_head import FINE_CHANNELS, VIT_CHANNELS, DptHead, edge_conv
from fecocodec.sender.extractors.depthsplat_small.backbone import MIDDLE, OUTPUT, Backbone, resized, whole_patches
from fecocodec.sender.extractors.depthsplat_small.cost_volume import NUM_CANDIDATES, candidate_depths
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall, Fusion, by_view, flat, require_whole
from fecocodec.sender.extractors.protocol import Images
from fecocodec.sender.extractors.vision_transformer import normalised

CHANNELS = 96
VIT_BLOCKS = (2, 5, 8, 11)  # whose maps are used
_NUM_FINE, _UPSAMPLER_CHANNELS = NUM_CANDIDATES // 4, 48  # candidates at the finer scale


@dataclass(frozen=True)
class Maps:
    """Outputs of the branches; item = (batch view).

    appearance: of the stages of the CNN, the first at 1/2, the others at the finer and the coarser scale of matching.
    multi_view: at the coarser and the finer scale. monocular: of four blocks of the ViT, at 1/8.
    """

    appearance: tuple[Float[Tensor, "item 64 h2 w2"], Float[Tensor, "item 96 hf wf"], Float[Tensor, "item 128 hc wc"]]
    multi_view: tuple[Float[Tensor, "item 128 hc wc"], Float[Tensor, "item 64 hf wf"]]
    monocular: list[Float[Tensor, "item vit h8 w8"]]


class Pyramid(nn.Module):
    """Features -> (the same, half as many at twice the resolution)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        finer = nn.ConvTranspose2d(channels, half, 2, 2), nn.GELU(), nn.Conv2d(half, half, 3, padding=1)
        self.stages = nn.ModuleList([nn.Identity(), nn.Sequential(*finer)])

    def forward(self, x: Float[Tensor, "item _ h w"]) -> tuple[Tensor, Tensor]:
        return x, self.stages[1](x)


class DepthPredictor(DepthSplatSmall):
    """The small network with a wider ViT; a second scale of matching at twice the resolution; heads for depth."""

    def __init__(self, lowest: int) -> None:
        super().__init__(vit_channels=VIT_CHANNELS)
        self.lowest, self.backbone = lowest, Backbone(middle_stride=lowest // 4)
        self.mv_pyramid, self.mono_pyramid = Pyramid(OUTPUT), Pyramid(VIT_CHANNELS)
        joined = _NUM_FINE + MIDDLE + FINE_CHANNELS + VIT_CHANNELS // 2
        self.regressor.append(Fusion(joined, FINE_CHANNELS, num_levels=4))
        self.regressor_residual.append(nn.Conv2d(joined, FINE_CHANNELS, 1))
        sizes = ((OUTPUT, NUM_CANDIDATES), (FINE_CHANNELS, _NUM_FINE))
        self.depth_head = nn.ModuleList(
            nn.Sequential(edge_conv(width, 2 * width), nn.GELU(), edge_conv(2 * width, count)) for width, count in sizes
        )
        self.upsampler = DptHead(_UPSAMPLER_CHANNELS, lowest, predicts_depth=True)

    def maps(self, images: Images, cameras: Cameras) -> Maps:
        """Run the branches. Arguments and errors as for `LargeExtractor.features`."""
        views, _, h, w = images.shape[1:]
        pictures = normalised(flat(images))
        appearance = self.backbone.scales(pictures)
        multi_view = flat(self.multi_view(by_view(appearance[-1], views), cameras))
        of_blocks = self.pretrained.maps(whole_patches(pictures), VIT_BLOCKS)
        return Maps(appearance, self.mv_pyramid(multi_view), [resized(x, (h // 8, w // 8)) for x in of_blocks])

    def monocular(self, maps: Maps) -> tuple[Tensor, Tensor]:
        """Return the last features of the ViT at the coarser and the finer scale."""
        h, w = (8 * side // self.lowest for side in maps.monocular[-1].shape[-2:])
        found: tuple[Tensor, Tensor] = self.mono_pyramid(resized(maps.monocular[-1], (h, w)))
        return found

    def depth(self, maps: Maps, cameras: Cameras) -> tuple[Float[Tensor, "item h w"], list[Tensor]]:
        """Return the depth of every view in the unit of the cameras, which it depends on, and the probabilities of the
        candidates at the coarser and the finer scale."""
        views = cameras.num_views
        low, high = ((1.0 / bound).repeat_interleave(views).view(-1, 1, 1, 1) for bound in (cameras.far, cameras.near))
        monocular, probabilities = self.monocular(maps), []
        candidates = 1.0 / candidate_depths(cameras).repeat_interleave(views, 0)[..., None, None]
        inverse = candidates[:, :1]
        for scale, features in enumerate(maps.multi_view):
            if scale:
                candidates = fine_candidates(low, high, resized(inverse, features.shape[-2:]))
            depths = rearrange(1.0 / candidates, "(b v) d h w -> b v (h w) d", v=views)
            costs = self.costs(by_view(features, views), cameras, depths)
            joined = torch.cat((costs, maps.appearance[-1 - scale], features, monocular[scale]), dim=1)
            fused = self.regressor[scale](joined, views) + self.regressor_residual[scale](joined)
            probabilities.append(self.depth_head[scale](fused).softmax(dim=1))
            inverse = (probabilities[-1] * candidates).sum(dim=1, keepdim=True)
        correction = self.upsampler(maps.monocular, maps.appearance, maps.multi_view, (inverse,))
        corrected = resized(inverse, correction.shape[-2:]) + correction
        return 1.0 / corrected.clamp(low, high)[:, 0], probabilities


def fine_candidates(low: Tensor, high: Tensor, around: Float[Tensor, "item 1 h w"]) -> Float[Tensor, "item _ h w"]:
    """Return inverse depths around an estimate, half as far apart as those of the coarse scale, inside the bounds."""
    step = (high - low) / (NUM_CANDIDATES - 1) / 2
    first = torch.maximum(around - step * (_NUM_FINE // 2), low)
    last = torch.minimum(around + step * (_NUM_FINE // 2 - 1), high)
    return first + torch.linspace(0.0, 1.0, _NUM_FINE, device=low.device)[:, None, None] * (last - first)


class DepthSplatBase(nn.Module):
    """The branches of the depth predictor -> DPT head. A `LargeExtractor` without weights, until they are loaded.

    The features need no depth; the public network is kept as a whole.
    """

    def __init__(self) -> None:
        super().__init__()
        self.arrange(4)

    def arrange(self, lowest: int) -> None:
        """Build the networks without weights. lowest: 4 for matching at 1/4 and 1/2 resolution; 8 for 1/8 and 1/4, as
        in the published checkpoints that saw DL3DV."""
        with torch.device("meta"):
            self.depth_predictor, self.feature_upsampler = DepthPredictor(lowest), DptHead(CHANNELS, lowest)
        self.eval().requires_grad_(False)

    def num_channels(self) -> int:
        return CHANNELS

    def maps(self, images: Images, cameras: Cameras) -> Maps:
        """Run the branches. Raises ModelError without weights, InputError for sides that they cannot divide."""
        if self.feature_upsampler.projects[0].weight.is_meta:
            raise ModelError("depthsplat-base: it has no weights yet; load its checkpoint by `load_frozen_extractor`.")
        require_whole(images, 4 * self.depth_predictor.lowest)
        return self.to(images.device).depth_predictor.maps(images, cameras)

    def features(self, images: Images, cameras: Cameras) -> Float[Tensor, "batch view 96 h w"]:
        maps = self.maps(images, cameras)
        found: Tensor = self.feature_upsampler(maps.monocular, maps.appearance, maps.multi_view)
        return found.unflatten(0, images.shape[:2])

    def fingerprint(self) -> str:
        """Return a digest of the names and values of all tensors."""
        digest = hashlib.sha256()
        for name, value in sorted(self.state_dict().items()):
            digest.update(name.encode() + value.cpu().contiguous().numpy().tobytes())
        return f"depthsplat-base-{digest.hexdigest()[:16]}"
