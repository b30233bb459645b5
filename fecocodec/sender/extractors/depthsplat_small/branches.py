"""The branches of DepthSplat's networks before fusion: CNN, multi-view transformer with its matching, and ViT."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_small.backbone import Backbone
from fecocodec.sender.extractors.depthsplat_small.cost_volume import (
    NUM_CANDIDATES,
    Positions,
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
from fecocodec.sender.extractors.vision_transformer import VisionTransformer

_POSITIONS: dict[str, Positions] = {"public": public_positions, "exact": exact_positions}
_MASKS_OF_SOURCES = {"public": public_masks_of_sources, "exact": masks_of_sources}


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

    def forward(self, x: Float[Tensor, "item _ h w"], num_views: int) -> Float[Tensor, "item channel h w"]:
        """item = (batch view)."""
        return self["4"](self["3"](F.gelu(self["1"](self["0"](x))), num_views))


class Branches(nn.Module):
    """images -> CNN -> multi-view transformer -> matching scores; images -> ViT."""

    def __init__(self, geometry: str, vit_channels: int) -> None:
        """geometry: "public" computes positions and masks as the public code does, as its checkpoints require; "exact"
        computes them without the errors of that code (see `public_positions`, `public_masks_of_sources`).

        Raises ModelError for an unknown geometry.
        """
        super().__init__()
        if geometry not in _POSITIONS:
            raise ModelError(
                f"geometry {geometry!r}: there is none of that name; choose one of {', '.join(_POSITIONS)}."
            )
        self.geometry = geometry
        self.backbone = Backbone()
        self.transformer = MultiViewTransformer()
        self.pretrained = VisionTransformer(vit_channels)

    def multi_view(
        self, features: Float[Tensor, "batch view channel h w"], cameras: Cameras
    ) -> Float[Tensor, "batch view channel h w"]:
        """Return features of the CNN after the transformer."""
        sources = source_views(cameras)
        within = border_mask(features.shape[-2], features.shape[-1], features.device)
        across = _MASKS_OF_SOURCES[self.geometry](within, sources.shape[-1])
        return self.transformer(features, sources, ScoreMasks(within, across))

    def costs(
        self,
        features: Float[Tensor, "batch view channel h w"],
        cameras: Cameras,
        depths: Float[Tensor, "batch view _ candidate"] | None = None,
    ) -> Float[Tensor, "item candidate h w"]:
        """Return matching scores, computed in float32; zero for a single view. depths: see `cost_volume`."""
        batch, views, _, h, w = features.shape
        if views == 1:
            return features.new_zeros(batch, NUM_CANDIDATES if depths is None else depths.shape[-1], h, w)
        sources, positions = source_views(cameras), _POSITIONS[self.geometry]
        with torch.autocast(features.device.type, enabled=False):
            return flat(cost_volume(features.float(), cameras, sources, positions, depths))


def require_multiples(images: Float[Tensor, "... 3 h w"], multiple: int) -> None:
    """Raise InputError if a side is not a multiple of so many pixels."""
    if images.shape[-2] % multiple or images.shape[-1] % multiple:
        raise InputError(f"images of {images.shape[-1]}x{images.shape[-2]} pixels: pad to multiples of {multiple}.")


def flat(x: Float[Tensor, "batch view channel h w"]) -> Float[Tensor, "item channel h w"]:
    """Join batch and views: item = (batch view)."""
    return rearrange(x, "b v c h w -> (b v) c h w")
