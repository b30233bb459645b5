"""What the encoder asks of a feature extractor E_mv, and what matching adds to the feedback of stage 1."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.scene import Guides

DIFFERENCE_SCALE = 10.0  # input scaling: typical differences of relative disparity are a few hundredths
Images = Float[Tensor, "batch view 3 h w"]


@dataclass(frozen=True)
class MatchedDepth:
    """Depth from matching, before fusion; item = (batch view). Has no gradient.

    relative_disparity: in [0, 1], 0 at far and 1 at near. consistency: cross-view consistency in [0, 1]; 0 where no
    other view confirms the depth.
    """

    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    consistency: Float[Tensor, "item 1 h4 w4"]

    @property
    def blended(self) -> Float[Tensor, "item 1 h4 w4"]:
        """The best estimate of relative disparity at each pixel."""
        return self.relative_disparity

    def moved_far(self, is_far: Bool[Tensor, "item 1 h4 w4"]) -> "MatchedDepth":
        """Return the same with these pixels at the far bound."""
        return replace(self, relative_disparity=self.relative_disparity * ~is_far)


def depth_feedback(matched: MatchedDepth, decoded: Float[Tensor, "item 1 h4 w4"]) -> Float[Tensor, "item 2 h4 w4"]:
    """Return the depth input of E_fb: the weighted difference matched - decoded, and its weight (the consistency).

    decoded: relative disparity predicted by the receiver. The Gaussians of a view render correctly at its own camera at
    any depth, so depth errors are hardly visible in the renderings.
    """
    difference = DIFFERENCE_SCALE * (matched.relative_disparity - decoded)
    return torch.cat((matched.consistency * difference, matched.consistency), dim=1).detach()


@dataclass(frozen=True)
class Matching:
    """Result of matching, before fusion; item = (batch view), at 1/4 resolution. Extractors add what `fuse` needs.

    relative_disparity: in [0, 1]; differentiable where training has a depth loss. depth: for the depth errors of E_fb.
    """

    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    depth: MatchedDepth


@runtime_checkable
class Extractor(Protocol):
    """E_mv = fuse(match). A module; `sender/model.py` has the table of those that weights files can name."""

    is_conditioned: bool  # whether F1 depends on lambda

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        """All trainable parts whose results `fuse` takes; training freezes them as "matching"."""

    def match(
        self,
        images: Images,
        cameras: Cameras,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> Any:
        """Return a `Matching`. images: sRGB in [0, 1], sides multiples of 32. cameras: normalised, a batch.

        guides, ignored: photographs that are not coded, and pixels that masks mark, which are filled from around them;
        of a batch of one scene. An extractor may do without.
        """

    def fuse(
        self, images: Images, matching: Any, condition: RateCondition | None = None
    ) -> Float[Tensor, "item channel h4 w4"]:
        """Return F1. matching: of `match`. condition: needed if `is_conditioned`."""
