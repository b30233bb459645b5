"""Depth from matching, and its difference from the decoded depth as feedback for stage 2."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

DIFFERENCE_SCALE = 10.0  # input scaling: typical differences of relative disparity are a few hundredths


@dataclass(frozen=True)
class MatchedDepth:
    """Depth from matching, before fusion; item = (batch view). Has no gradient.

    relative_disparity: in [0, 1], 0 at far and 1 at near. consistency: cross-view consistency in [0, 1]; 0 where no
    other view confirms the depth.
    """

    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    consistency: Float[Tensor, "item 1 h4 w4"]


def depth_feedback(matched: MatchedDepth, decoded: Float[Tensor, "item 1 h4 w4"]) -> Float[Tensor, "item 2 h4 w4"]:
    """Return the depth input of E_fb: the weighted difference matched - decoded, and its weight (the consistency).

    decoded: relative disparity predicted by the receiver. The Gaussians of a view render correctly at its own camera at
    any depth, so depth errors are hardly visible in the renderings.
    """
    difference = DIFFERENCE_SCALE * (matched.relative_disparity - decoded)
    return torch.cat((matched.consistency * difference, matched.consistency), dim=1).detach()
