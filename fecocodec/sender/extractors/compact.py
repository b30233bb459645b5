"""The compact multi-view extractor E_mv: posed photographs -> geometry-aware features at 1/4 resolution."""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from fecocodec.config import SenderConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import joined_masks
from fecocodec.grid import FEATURES, VALUES_PER_CELL
from fecocodec.layers.blocks import PlainBlock2d, PointwiseConv2d, RateCondition, downsample, upsample
from fecocodec.sender.extractors.cross_view import CrossViewAttention
from fecocodec.sender.extractors.cross_view_consistency import cross_view_consistency
from fecocodec.sender.extractors.photo_consistency import photo_consistency
from fecocodec.sender.extractors.plane_extrapolation import extrapolate_planes
from fecocodec.sender.extractors.plane_sweep import cost_volume, source_views
from fecocodec.sender.extractors.protocol import MatchedDepth, Matching
from fecocodec.sender.extractors.semi_global import aggregate_costs
from fecocodec.sender.scene import Guides

PYRAMID_LEVELS = 3  # matching runs at full, half and quarter image size
FIRST_TEMPERATURES = (1.2, 1.2, 1.2, 1.8)  # initial log weights of the pyramid levels and of photo-consistency
SHARPNESS = 0.5  # factor before the softmax: aggregated scores differ more than those before aggregation


@dataclass(frozen=True)
class MatchedMaps(MatchedDepth):
    """Result of the aggregation of matching scores, without gradient; item = (batch view), 1/4 resolution, in [0, 1].

    confidence: largest probability of the disparity. extrapolated: relative disparity of the planes of confirmed
    neighbours.
    """

    confidence: Float[Tensor, "item 1 h4 w4"]
    extrapolated: Float[Tensor, "item 1 h4 w4"]

    @property
    def blended(self) -> Float[Tensor, "item 1 h4 w4"]:
        """Matched disparity where it is consistent, extrapolated disparity elsewhere."""
        return torch.lerp(self.extrapolated, self.relative_disparity, self.consistency)

    def moved_far(self, is_far: Bool[Tensor, "item 1 h4 w4"]) -> "MatchedMaps":
        """Return the same with these pixels at the far bound, extrapolated ones, too."""
        disparity, extrapolated = self.relative_disparity * ~is_far, self.extrapolated * ~is_far
        return replace(self, relative_disparity=disparity, extrapolated=extrapolated)


@dataclass(frozen=True)
class SweptMatching(Matching):
    """Result of the plane sweep. cost: score of each depth candidate. relative_disparity: mean under its softmax."""

    depth: MatchedMaps
    appearance: Float[Tensor, "item stem h4 w4"]
    cost: Float[Tensor, "item candidate h4 w4"]


class CompactExtractor(nn.Module):
    """images -> CNN (1/4) -> cross-view attention (1/8) -> plane sweep -> aggregation -> U-Net (1/4 to 1/16) -> F1.

    All steps before the aggregation run on an image pyramid of three levels. The U-Net also takes the pixels (pixel
    unshuffle 4), because the latent must carry colour as well as geometry. Where no other view confirms a depth, planes
    of confirmed neighbours are extrapolated.
    """

    is_conditioned = False

    def __init__(self, config: SenderConfig, channels: int) -> None:
        super().__init__()
        self.config = config
        stem, (fine, middle, coarse) = config.stem_channels, config.fusion_channels
        self.stem = nn.Sequential(
            nn.Conv2d(3, 32, 5, stride=2, padding=2),
            nn.GELU(approximate="tanh"),
            nn.Conv2d(32, stem, 3, stride=2, padding=1),
            PlainBlock2d(stem, stem),
            PlainBlock2d(stem, stem),
        )
        self.down_stem = downsample(stem, config.attention_channels)
        self.cross_view = nn.ModuleList(CrossViewAttention(config.attention_channels) for _ in range(2))
        self.up_attended = upsample(config.attention_channels, stem)
        self.matching_head = nn.Conv2d(stem, config.matching_channels, 3, padding=1)
        self.log_temperature = nn.Parameter(torch.tensor(FIRST_TEMPERATURES))
        self.input = PointwiseConv2d(2 * stem + config.num_candidates + 3 + VALUES_PER_CELL, fine)
        self.fine_in, self.fine_out = PlainBlock2d(fine, fine), PlainBlock2d(fine, fine)
        self.middle_in, self.middle_out = PlainBlock2d(middle, middle), PlainBlock2d(middle, middle)
        self.coarse = nn.Sequential(PlainBlock2d(coarse, coarse), PlainBlock2d(coarse, coarse))
        self.down_fine, self.down_middle = downsample(fine, middle), downsample(middle, coarse)
        self.up_coarse, self.up_middle = upsample(coarse, middle), upsample(middle, fine)
        self.output = PointwiseConv2d(fine, channels)

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        """All parts whose results `fuse` takes."""
        return (
            self.stem, self.down_stem, self.cross_view, self.up_attended, self.matching_head, self.log_temperature,
        )  # fmt: skip

    def match(
        self,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> SweptMatching:
        """Compute the features of all views, the cost volume, and depth with its cross-view consistency.

        Scores are summed over an image pyramid: coarse levels resolve ambiguities of the fine ones. Photo-consistency
        of the images is added: correlation of pixel windows is less distinctive than learned features, but localises
        more precisely. guides: further sources of the disparity and its consistency; the cost volume and appearance,
        which the U-Net was trained on, are those of the context views alone. ignored: pixels without scores,
        consistency and confidence, in the view and as sources.
        """
        sources, kept = source_views(cameras, self.config.num_source_views), _kept(ignored)
        appearance, cost = self._scores(images, cameras, sources, kept)
        if guides is not None:
            maps = self._guided_maps(images, cameras, guides, ignored)
        else:
            maps = self._aggregated(cost, images, cameras, sources, kept)
        return SweptMatching(_expectation(cost.softmax(dim=1)), maps, appearance, cost)

    def _guided_maps(
        self,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        guides: Guides,
        ignored: Bool[Tensor, "view h w"] | None,
    ) -> MatchedMaps:
        """Return the maps of the context views, with guides among their sources."""
        count, num_sources = images.shape[1], self.config.num_source_views
        chosen = source_views(cameras.joined(guides.cameras.as_batch()), num_sources)[0, :count]
        guides = guides.select(sorted({view - count for view in chosen.flatten().tolist() if view >= count}))
        of_all = torch.cat((images, guides.images[None]), dim=1), cameras.joined(guides.cameras.as_batch())
        sources = source_views(of_all[1], num_sources)
        kept = _kept(joined_masks([(ignored, images[0]), (guides.ignored, guides.images)]))
        return self._aggregated(self._scores(*of_all, sources, kept)[1], *of_all, sources, kept, count)

    def _scores(
        self,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        sources: Int[Tensor, "batch view count"],
        kept: Float[Tensor, "view 1 _ _"] | None,
    ) -> tuple[Float[Tensor, "item channel h4 w4"], Float[Tensor, "item candidate h4 w4"]]:
        """Return appearance features, and the matching score of each depth candidate."""
        agreement = _flat(photo_consistency(images, cameras, sources, self.config.num_candidates))
        if kept is not None:
            agreement = agreement * _reduced(kept, agreement)
        appearance, cost = self._match_level(images, cameras, sources, kept)
        cost = cost * self.log_temperature[0].exp()
        for log_temperature in self.log_temperature[1:PYRAMID_LEVELS]:
            images = rearrange(F.avg_pool2d(_flat(images), 2), "(b v) c h w -> b v c h w", b=len(images))
            coarse = self._match_level(images, cameras, sources, kept)[1] * log_temperature.exp()
            cost = cost + F.interpolate(coarse, cost.shape[-2:], mode="bilinear", align_corners=False)
        return appearance, cost + agreement * self.log_temperature[PYRAMID_LEVELS].exp()

    def _aggregated(
        self,
        cost: Float[Tensor, "item candidate h4 w4"],
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        sources: Int[Tensor, "batch view count"],
        kept: Float[Tensor, "view 1 _ _"] | None,
        count: int | None = None,
    ) -> MatchedMaps:
        """Return the maps of the first `count` items; None for all."""
        photographs = _flat(images)
        probability = (SHARPNESS * aggregate_costs(cost.detach(), F.avg_pool2d(photographs, FEATURES))).softmax(dim=1)
        disparity = _expectation(probability)
        of_views = rearrange(disparity, "(b v) 1 h w -> b v h w", b=len(images))
        known = None if kept is None else _reduced(kept, disparity)
        of_known = None if known is None else known[None, :, 0]
        consistency = _flat(cross_view_consistency(of_views, cameras, sources, of_known)[:, :, None])[:count]
        extrapolated = extrapolate_planes(disparity[:count], consistency, photographs[:count])
        confidence = probability[:count].amax(dim=1, keepdim=True)
        confidence = confidence if known is None else confidence * known[:count]
        return MatchedMaps(disparity[:count], consistency, confidence, extrapolated)

    def _match_level(
        self,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        sources: Int[Tensor, "batch view count"],
        kept: Float[Tensor, "view 1 _ _"] | None,
    ) -> tuple[Float[Tensor, "item channel h4 w4"], Float[Tensor, "item candidate h4 w4"]]:
        """Return appearance features, and correlations in [-1, 1], at one level of the pyramid."""
        batch, views = images.shape[:2]
        appearance = self.stem(_flat(images) * 2.0 - 1.0)
        attended = rearrange(self.down_stem(appearance), "(b v) c h w -> b v c h w", v=views)
        for layer in self.cross_view:
            attended = layer(attended, sources)
        appearance = torch.cat((appearance, self.up_attended(_flat(attended))), dim=1)
        stem = self.config.stem_channels
        features = F.normalize(self.matching_head(appearance[:, :stem] + appearance[:, stem:]).float(), dim=1)
        if kept is not None:
            features = features * _reduced(kept, features)
        features = rearrange(features, "(b v) c h w -> b v c h w", b=batch)
        return appearance, _flat(cost_volume(features, cameras, sources, self.config.num_candidates))

    def fuse(
        self, images: Float[Tensor, "batch view 3 h w"], matching: SweptMatching, condition: RateCondition | None = None
    ) -> Float[Tensor, "item channel h4 w4"]:
        """Return F1: the U-Net applied to appearance, matching results and pixels."""
        pixels = F.pixel_unshuffle(_flat(images) * 2.0 - 1.0, FEATURES)
        maps, disparity = matching.depth, 2.0 * matching.depth.blended - 1.0
        inputs = (matching.appearance, matching.cost / 8.0, maps.consistency, disparity, maps.confidence)
        fine = self.fine_in(self.input(torch.cat((*inputs, pixels), dim=1)))
        middle = self.middle_in(self.down_fine(fine))
        coarse = self.coarse(self.down_middle(middle))
        middle = self.middle_out(middle + self.up_coarse(coarse))
        return self.output(self.fine_out(fine + self.up_middle(middle)))


def _flat(x: Float[Tensor, "batch view channel h w"]) -> Float[Tensor, "item channel h w"]:
    return rearrange(x, "b v c h w -> (b v) c h w")


def _kept(ignored: Bool[Tensor, "view h w"] | None) -> Float[Tensor, "view 1 h w"] | None:
    """Return 1 for pixels that no mask marks, else 0; None without masks."""
    return None if ignored is None else (~ignored)[:, None].float()


def _reduced(kept: Float[Tensor, "view 1 _ _"], like: Float[Tensor, "view _ h w"]) -> Float[Tensor, "view 1 h w"]:
    """Return the share of each position that no mask marks."""
    return F.adaptive_avg_pool2d(kept, (like.shape[-2], like.shape[-1]))


def _expectation(probability: Float[Tensor, "item candidate h w"]) -> Float[Tensor, "item 1 h w"]:
    """Return the expected relative disparity, in [0, 1]."""
    candidates = torch.linspace(0.0, 1.0, probability.shape[1], device=probability.device)
    return torch.einsum("idhw,d->ihw", probability, candidates)[:, None]
