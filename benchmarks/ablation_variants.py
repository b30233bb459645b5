"""The variants of `ablate_training.py`: each function changes networks with trained weights in place.

A part that is to behave otherwise takes another class and keeps its weights. New parts begin as nothing (zero output),
or as the very function they replace, so that training starts where "as it is" starts.
"""

from typing import TypeVar

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from fecocodec.coding.priors import LatentPrior
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_1, Gaussians
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.neighbour_attention import NeighbourAttention
from fecocodec.receiver.predictor import PER_CELL, RAW, Predictor
from fecocodec.sender.feedback import FeedbackExtractor
from fecocodec.sender.model import Sender

DIRECTIONAL = 9  # head outputs a Gaussian: a vector of each colour, along which it grows
PIXELS = 48  # channels of a photograph after pixel unshuffle 4
DEPTH_ERRORS = 2  # channels that E_fb is told of depth

Kind = TypeVar("Kind", bound=nn.Module)


def _become(part: nn.Module, kind: type[Kind]) -> Kind:
    part.__class__ = kind
    assert isinstance(part, kind)
    return part


class _PriorWithoutContext(LatentPrior):
    def features(self, z_hat_q8: Tensor, condition_q8: Tensor, context_q8: Tensor | None) -> Tensor:
        return super().features(z_hat_q8, condition_q8, None)


def drop_prior_context(sender: Sender, receiver: Receiver) -> None:
    """Stage 2's latent is coded as if stage 1's were not known."""
    _become(receiver.prior, _PriorWithoutContext)


class _FeedbackOfRendering(FeedbackExtractor):
    def forward(self, images: Tensor, renderings: Tensor, depth_errors: Tensor, condition: RateCondition) -> Tensor:
        stacked = torch.cat((2.0 * images - 1.0, 2.0 * renderings - 1.0), dim=1)
        return self.blocks(self.input(torch.cat((F.pixel_unshuffle(stacked, 4), depth_errors), dim=1)), condition)


@torch.no_grad()
def feed_back_rendering(sender: Sender, receiver: Receiver) -> None:
    """E_fb gets photograph and rendering, as in the paper; its first layer is rewritten to compute the same."""
    old = sender.feedback.input
    # 4 (I - R) = 2 (2 I - 1) - 2 (2 R - 1)
    of_photograph, of_difference, of_depth = old.weight.split((PIXELS, PIXELS, DEPTH_ERRORS), dim=1)
    weight = torch.cat((of_photograph + 2 * of_difference, -2 * of_difference, of_depth), dim=1)
    sender.feedback.input = nn.Conv2d(old.in_channels, old.out_channels, 1)
    sender.feedback.input.weight.copy_(weight)
    sender.feedback.input.bias = old.bias
    _become(sender.feedback, _FeedbackOfRendering)


class _FeedbackOfDifference(FeedbackExtractor):
    def forward(self, images: Tensor, renderings: Tensor, depth_errors: Tensor, condition: RateCondition) -> Tensor:
        grey = torch.full_like(images, 0.5)  # which E_fb takes as zero
        return super().forward(grey, grey + renderings - images, depth_errors, condition)


def feed_back_difference_alone(sender: Sender, receiver: Receiver) -> None:
    """E_fb does not see the photograph, only what the rendering lacks of it."""
    _become(sender.feedback, _FeedbackOfDifference)


class _FeedbackOfPhotograph(FeedbackExtractor):
    def forward(self, images: Tensor, renderings: Tensor, depth_errors: Tensor, condition: RateCondition) -> Tensor:
        return super().forward(images, images, depth_errors, condition)


def feed_back_photograph_alone(sender: Sender, receiver: Receiver) -> None:
    """E_fb does not see the rendering, only what depth lacks."""
    _become(sender.feedback, _FeedbackOfPhotograph)


class _FeedbackWithFeatures(FeedbackExtractor):
    stem: tuple[nn.Module]  # in a tuple: it belongs to the extractor
    of_features: nn.Conv2d

    def forward(self, images: Tensor, renderings: Tensor, depth_errors: Tensor, condition: RateCondition) -> Tensor:
        stacked = torch.cat((2.0 * images - 1.0, 4.0 * (images - renderings)), dim=1)
        with torch.no_grad():
            seen, rendered = (self.stem[0](2.0 * pictures - 1.0) for pictures in (images, renderings))
        told = torch.cat((F.pixel_unshuffle(stacked, 4), depth_errors), dim=1)
        fine = self.input(told) + self.of_features(seen - rendered)
        return self.blocks(fine, condition)


def compare_features(sender: Sender, receiver: Receiver) -> None:
    """E_fb also gets the difference between the extractor's CNN features of photograph and rendering."""
    feedback = _become(sender.feedback, _FeedbackWithFeatures)
    feedback.stem = (sender.extractor.stem,)
    feedback.of_features = nn.Conv2d(sender.extractor.config.stem_channels, feedback.input.out_channels, 1)
    _silence(feedback.of_features)


class _NoAttention(NeighbourAttention):
    def forward(self, features: Tensor, points: Tensor, depth: Tensor, world_to_view: Tensor) -> Tensor:
        return torch.zeros_like(features)


def drop_attention(sender: Sender, receiver: Receiver) -> None:
    """The predictor works without attention over 3D neighbours."""
    _become(receiver.predictor.attention, _NoAttention)


def halve_neighbours(sender: Sender, receiver: Receiver) -> None:
    """The attention is over 8 points in place of 16."""
    receiver.predictor.attention.num_neighbours //= 2


class _AttentionTwice(NeighbourAttention):
    second: NeighbourAttention

    def forward(self, features: Tensor, points: Tensor, depth: Tensor, world_to_view: Tensor) -> Tensor:
        found = super().forward(features, points, depth, world_to_view)
        return found + self.second(features + found, points, depth, world_to_view)


def attend_twice(sender: Sender, receiver: Receiver) -> None:
    """A second block of attention over the same neighbours."""
    config, attention = receiver.config, receiver.predictor.attention
    second = NeighbourAttention(config.state_channels, config.attention_channels, config.num_neighbours)
    _silence(second.output)
    _become(attention, _AttentionTwice).second = second


class _SideBySide(nn.Module):
    """Two layers on the same input, their channels one after the other."""

    def __init__(self, first: nn.Module, second: nn.Module) -> None:
        super().__init__()
        self.first, self.second = first, second

    def forward(self, x: Tensor) -> Tensor:
        return torch.cat((self.first(x), self.second(x)), dim=1)


class _DirectionalPredictor(Predictor):
    def _activate(self, raw: Tensor, relative: Tensor, cameras: Cameras) -> Gaussians:
        """The colour seen along a unit direction d of the world gains v . d; v is predicted in the view's own axes."""
        plain, along = raw.split((sum(RAW.values()), DIRECTIONAL), dim=-1)
        gaussians = super()._activate(plain, relative, cameras)
        along = rearrange(along, "b v h w (xyz rgb) -> b v h w xyz rgb", xyz=3)
        along = torch.einsum("bvij,bvhwjc->bvhwic", cameras.extrinsics[..., :3, :3], along)
        x, y, z = rearrange(along, "b v h w xyz rgb -> xyz b (v h w) rgb") / SH_DEGREE_1
        harmonics = torch.cat((gaussians.harmonics, torch.stack((-y, z, -x), dim=-2)), dim=-2)
        return Gaussians(gaussians.means, gaussians.scales, gaussians.rotations, gaussians.opacities, harmonics)


def colour_by_direction(sender: Sender, receiver: Receiver) -> None:
    """Gaussians with spherical harmonics of degree 1."""
    predictor = receiver.predictor
    extra = nn.Conv2d(receiver.config.state_channels, PER_CELL * DIRECTIONAL, 1)
    _silence(extra)
    predictor.head[2] = _SideBySide(predictor.head[2], extra)
    _become(predictor, _DirectionalPredictor)


class _CoarsePredictor(Predictor):
    def _activate(self, raw: Tensor, relative: Tensor, cameras: Cameras) -> Gaussians:
        pooled = F.avg_pool2d(rearrange(raw, "b v h w c -> (b v) c h w"), 2)
        return super()._activate(rearrange(pooled, "(b v) c h w -> b v h w c", b=len(raw)), relative, cameras)


def gaussians_at_quarter(sender: Sender, receiver: Receiver) -> None:
    """One Gaussian a cell of the 1/4 grid, twice as wide: at first the mean of the four that were there."""
    _become(receiver.predictor, _CoarsePredictor)


class _FinePredictor(Predictor):
    def _activate(self, raw: Tensor, relative: Tensor, cameras: Cameras) -> Gaussians:
        """`raw` holds a Gaussian's outputs, then what each of the four that take its place has of its own."""
        batch, outputs = len(raw), sum(RAW.values())
        shared, own = rearrange(raw, "b v h w c -> (b v) c h w").split((outputs, 4 * outputs), dim=1)
        fine = F.interpolate(shared, scale_factor=2.0, mode="nearest") + F.pixel_shuffle(own, 2)
        return super()._activate(rearrange(fine, "(b v) c h w -> b v h w c", b=batch), relative, cameras)


def gaussians_at_full(sender: Sender, receiver: Receiver) -> None:
    """One Gaussian a pixel, half as wide: at first four like the one that was there, side by side."""
    predictor = receiver.predictor
    own = nn.Conv2d(receiver.config.state_channels, PER_CELL * 4 * sum(RAW.values()), 1)
    _silence(own)
    predictor.head[2] = _SideBySide(predictor.head[2], own)
    _become(predictor, _FinePredictor)


def _silence(layer: nn.Module) -> None:
    """Let a new layer start with zero output, to learn from there."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
