"""Matched depth, and its difference to the receiver's depth as feedback."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

DIFFERENCE_SCALE = 10.0  # differences of relative disparity are a few hundredths


@dataclass(frozen=True)
class MatchedDepth:
    """Depth from matching, before fusion; item = (batch view), no gradient.

    agreement: cross-view consistency in [0, 1]; 0 where no other view confirms the depth.
    """

    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    agreement: Float[Tensor, "item 1 h4 w4"]


def depth_feedback(matched: MatchedDepth, decoded: Float[Tensor, "item 1 h4 w4"]) -> Float[Tensor, "item 2 h4 w4"]:
    """Input of E_fb: matched minus decoded relative disparity, weighted by the agreement; the agreement.

    A view's own Gaussians look right at its own camera at any depth, so that renderings hardly show depth errors.
    """
    difference = DIFFERENCE_SCALE * (matched.relative_disparity - decoded)
    return torch.cat((matched.agreement * difference, matched.agreement), dim=1).detach()
