"""DepthSplat-Small's features: posed photographs -> F1 at 1/4 resolution."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.extractors.cross_view_consistency import cross_view_consistency
from fecocodec.sender.extractors.depthsplat_small.backbone import monocular_features
from fecocodec.sender.extractors.depthsplat_small.branches import Branches, Fusion, flat, require_multiples
from fecocodec.sender.extractors.depthsplat_small.cost_volume import NUM_CANDIDATES, source_views
from fecocodec.sender.extractors.depthsplat_small.unet import CHANNELS
from fecocodec.sender.extractors.protocol import MatchedDepth
from fecocodec.sender.extractors.vision_transformer import CHANNELS as MONOCULAR_CHANNELS
from fecocodec.sender.extractors.vision_transformer import normalised
from fecocodec.sender.scene import Guides

SIDE_MULTIPLE = 16  # pixels


@dataclass(frozen=True)
class Evidence:
    """Outputs of the branches, before fusion; item = (batch view), all at 1/4 resolution.

    cost: matching score of each depth candidate. relative_disparity: expectation over the softmax of `cost`, in [0, 1].
    consistency: cross-view consistency of the relative disparity, in [0, 1].
    """

    cost: Float[Tensor, "item candidate h4 w4"]
    appearance: Float[Tensor, "item channel h4 w4"]
    multi_view: Float[Tensor, "item channel h4 w4"]
    monocular: Float[Tensor, "item mono h4 w4"]
    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    consistency: Float[Tensor, "item 1 h4 w4"]
    num_views: int

    @property
    def depth(self) -> MatchedDepth:
        """Depth for the feedback of stage 2."""
        return MatchedDepth(self.relative_disparity.detach(), self.consistency)


class DepthSplatSmall(Branches):
    """images -> CNN -> multi-view transformer -> cost volume; images -> ViT; all four -> cross-view U-Net -> F1.

    The U-Net's output is added to a 1x1 convolution of its input.
    """

    is_conditioned = False

    def __init__(self, geometry: str = "public", matching_scale: int = 1) -> None:
        """geometry: see `Branches`, which raises ModelError for an unknown one.

        matching_scale: 2 builds the cost volume at half the resolution of the features, as the paper does for DL3DV.
        """
        super().__init__(geometry, MONOCULAR_CHANNELS)
        self.matching_scale = matching_scale
        joined = NUM_CANDIDATES + 2 * CHANNELS + MONOCULAR_CHANNELS
        self.regressor = nn.ModuleList([Fusion(joined)])
        self.regressor_residual = nn.ModuleList([nn.Conv2d(joined, CHANNELS, 1)])

    def forward(self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> Float[Tensor, "item 128 h4 w4"]:
        """Return F1 of every view. images: sRGB in [0, 1], sides multiples of 16. cameras: normalised scenes."""
        return self.fuse(images, self.match(images, cameras))

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        """Nothing: its branches are frozen one by one, or as the whole extractor."""
        return ()

    def match(
        self,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> Evidence:
        """Run the three branches and build the cost volume, without guides and masks.

        Raises InputError if a side is not a multiple of 16.
        """
        require_multiples(images, SIDE_MULTIPLE)
        views = images.shape[1]
        pictures = normalised(flat(images))
        appearance = self.backbone(pictures)
        multi_view = self.multi_view(rearrange(appearance, "(b v) c h w -> b v c h w", v=views), cameras)
        cost = self._cost(multi_view, cameras)
        share = torch.linspace(0.0, 1.0, NUM_CANDIDATES, device=images.device)
        expected = torch.einsum("idhw,d->ihw", cost.float().softmax(dim=1), share)[:, None]
        monocular = monocular_features(self.pretrained, pictures)
        disparity = rearrange(expected, "(b v) 1 h w -> b v h w", v=views)
        consistency = cross_view_consistency(disparity, cameras, source_views(cameras))
        return Evidence(cost, appearance, flat(multi_view), monocular, expected, flat(consistency[:, :, None]), views)

    def fuse(
        self, images: Float[Tensor, "batch view 3 h w"], matching: Evidence, condition: RateCondition | None = None
    ) -> Float[Tensor, "item 128 h4 w4"]:
        """Return F1: the U-Net applied to the outputs of the branches. The images are not used."""
        parts = (matching.cost, matching.appearance, matching.multi_view, matching.monocular)
        joined = torch.cat([part.to(matching.appearance.dtype) for part in parts], dim=1)
        return self.regressor[0](joined, matching.num_views) + self.regressor_residual[0](joined)

    def _cost(
        self, features: Float[Tensor, "batch view channel h w"], cameras: Cameras
    ) -> Float[Tensor, "item candidate h w"]:
        """Return matching scores at the resolution of the features, see `costs`."""
        views, _, h, w = features.shape[1:]
        size = (h // self.matching_scale, w // self.matching_scale)
        at_scale = rearrange(_resize(flat(features).float(), size), "(b v) c h w -> b v c h w", v=views)
        return _resize(self.costs(at_scale, cameras), (h, w))


def _resize(x: Float[Tensor, "item channel _ _"], size: tuple[int, int]) -> Float[Tensor, "item channel _ _"]:
    if x.shape[-2:] == size:
        return x
    return F.interpolate(x, size, mode="bilinear", align_corners=False)
