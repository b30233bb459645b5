"""DepthSplat-Small's features: posed photographs -> F1 at 1/4 resolution."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import FeatureMaps, RateCondition
from fecocodec.sender.extractors.cross_view_consistency import cross_view_consistency
from fecocodec.sender.extractors.depthsplat_small.backbone import Backbone, monocular_features
from fecocodec.sender.extractors.depthsplat_small.cost_volume import (
    NUM_CANDIDATES,
    Positions,
    candidate_depths,
    cost_volume,
    exact_positions,
    public_positions,
    source_views,
)
from fecocodec.sender.extractors.depthsplat_small.transformer import (
    MultiViewTransformer,
    ScoreMasks,
    border_mask,
    masks_of_sources,
    public_masks_of_sources,
)
from fecocodec.sender.extractors.depthsplat_small.unet import CHANNELS, NUM_LEVELS, CrossViewUNet
from fecocodec.sender.extractors.protocol import Images, MatchedDepth, Matching
from fecocodec.sender.extractors.vision_transformer import CHANNELS as MONOCULAR_CHANNELS
from fecocodec.sender.extractors.vision_transformer import VisionTransformer, normalised
from fecocodec.sender.scene import Guides

SIDE_MULTIPLE = 16  # pixels
_POSITIONS: dict[str, Positions] = {"public": public_positions, "exact": exact_positions}
_MASKS_OF_SOURCES = {"public": public_masks_of_sources, "exact": masks_of_sources}
ByView = Float[Tensor, "batch view channel h w"]


@dataclass(frozen=True)
class Evidence(Matching):
    """Outputs of the branches. cost: score of each depth candidate. relative_disparity: mean under its softmax."""

    cost: Float[Tensor, "item candidate h4 w4"]
    appearance: Float[Tensor, "item channel h4 w4"]
    multi_view: Float[Tensor, "item channel h4 w4"]
    monocular: Float[Tensor, "item mono h4 w4"]
    num_views: int


class Fusion(nn.ModuleDict):
    """3x3 conv -> group norm -> GELU -> cross-view U-Net -> 3x3 conv. Keys are those of the public checkpoints."""

    def __init__(self, in_channels: int, channels: int = CHANNELS, num_levels: int = NUM_LEVELS) -> None:
        super().__init__(
            {
                "0": nn.Conv2d(in_channels, channels, 3, padding=1),
                "1": nn.GroupNorm(8, channels),
                "3": CrossViewUNet(channels, num_levels),
                "4": nn.Conv2d(channels, channels, 3, padding=1),
            }
        )

    def forward(self, x: Float[Tensor, "item _ h w"], num_views: int) -> FeatureMaps:
        """item = (batch view)."""
        return self["4"](self["3"](F.gelu(self["1"](self["0"](x))), num_views))


class DepthSplatSmall(nn.Module):
    """images -> CNN -> multi-view transformer -> cost volume; images -> ViT; all four -> cross-view U-Net -> F1.

    The U-Net's output is added to a 1x1 convolution of its input.
    """

    is_conditioned = False

    def __init__(
        self, geometry: str = "public", matching_scale: int = 1, vit_channels: int = MONOCULAR_CHANNELS
    ) -> None:
        """geometry: "public" computes positions and masks as the public code does, as its checkpoints require; "exact"
        computes them without the errors of that code (see `public_positions`, `public_masks_of_sources`).

        matching_scale: 2 builds the cost volume at half the resolution of the features, as the paper does for DL3DV.
        vit_channels: width of the ViT. Raises ModelError for an unknown geometry.
        """
        super().__init__()
        if geometry not in _POSITIONS:
            raise ModelError(
                f"geometry {geometry!r}: there is none of that name; choose one of {', '.join(_POSITIONS)}."
            )
        self.geometry, self.matching_scale = geometry, matching_scale
        self.backbone = Backbone()
        self.transformer = MultiViewTransformer()
        self.pretrained = VisionTransformer(vit_channels)
        joined = NUM_CANDIDATES + 2 * CHANNELS + vit_channels
        self.regressor = nn.ModuleList([Fusion(joined)])
        self.regressor_residual = nn.ModuleList([nn.Conv2d(joined, CHANNELS, 1)])

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        """Nothing: its branches are frozen one by one, or as the whole extractor."""
        return ()

    def match(
        self,
        images: Images,
        cameras: Cameras,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> Evidence:
        """Run the branches and build the cost volume. Raises InputError for sides that are not multiples of 16."""
        require_whole(images, SIDE_MULTIPLE)
        views = images.shape[1]
        pictures = normalised(flat(images))
        appearance = self.backbone(pictures)
        multi_view = self.multi_view(by_view(appearance, views), cameras)
        cost = self._cost(multi_view, cameras)
        share = torch.linspace(0.0, 1.0, NUM_CANDIDATES, device=images.device)
        expected = torch.einsum("idhw,d->ihw", cost.float().softmax(dim=1), share)[:, None]
        monocular = monocular_features(self.pretrained, pictures)
        disparity = rearrange(expected, "(b v) 1 h w -> b v h w", v=views)
        consistency = cross_view_consistency(disparity, cameras, source_views(cameras))
        depth = MatchedDepth(expected.detach(), flat(consistency[:, :, None]))
        return Evidence(expected, depth, cost, appearance, flat(multi_view), monocular, views)

    def fuse(
        self, images: Images, matching: Evidence, condition: RateCondition | None = None
    ) -> Float[Tensor, "item 128 h4 w4"]:
        """Return F1: the U-Net applied to the outputs of the branches. The images are not used."""
        parts = (matching.cost, matching.appearance, matching.multi_view, matching.monocular)
        joined = torch.cat([part.to(matching.appearance.dtype) for part in parts], dim=1)
        return self.regressor[0](joined, matching.num_views) + self.regressor_residual[0](joined)

    def multi_view(self, features: ByView, cameras: Cameras) -> ByView:
        """Return features of the CNN after the transformer."""
        sources = source_views(cameras)
        within = border_mask(features.shape[-2], features.shape[-1], features.device)
        across = _MASKS_OF_SOURCES[self.geometry](within, sources.shape[-1])
        return self.transformer(features, sources, ScoreMasks(within, across))

    def _cost(self, features: ByView, cameras: Cameras) -> Float[Tensor, "item candidate h w"]:
        views, _, h, w = features.shape[1:]
        size = (h // self.matching_scale, w // self.matching_scale)
        depths = rearrange(candidate_depths(cameras), "b d -> b 1 1 d").expand(-1, views, -1, -1)
        return _resize(self.costs(by_view(_resize(flat(features), size), views), cameras, depths), (h, w))

    def costs(
        self, features: ByView, cameras: Cameras, depths: Float[Tensor, "batch view _ candidate"]
    ) -> Float[Tensor, "item candidate h w"]:
        """Return matching scores, computed in float32; zero for a single view. depths: see `cost_volume`."""
        batch, views, _, h, w = features.shape
        if views == 1:
            return features.new_zeros(batch, depths.shape[-1], h, w)
        with torch.autocast(features.device.type, enabled=False):
            positions = _POSITIONS[self.geometry]
            return flat(cost_volume(features.float(), cameras, source_views(cameras), positions, depths))


def _resize(x: Float[Tensor, "item channel _ _"], size: tuple[int, int]) -> Float[Tensor, "item channel _ _"]:
    if x.shape[-2:] == size:
        return x
    return F.interpolate(x, size, mode="bilinear", align_corners=False)


def require_whole(images: Images, multiple: int) -> None:
    """Raise InputError if a side of the images is not a multiple of so many pixels."""
    if images.shape[-2] % multiple or images.shape[-1] % multiple:
        raise InputError(f"images of {images.shape[-1]}x{images.shape[-2]} pixels: pad to multiples of {multiple}.")


def by_view(x: FeatureMaps, views: int) -> ByView:
    """Undo `flat`. views: number of views of a scene."""
    return rearrange(x, "(b v) c h w -> b v c h w", v=views)


def flat(x: ByView) -> FeatureMaps:
    """Return the views of all scenes in a row: item = (batch view)."""
    return rearrange(x, "b v c h w -> (b v) c h w")
