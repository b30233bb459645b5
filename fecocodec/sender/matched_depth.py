"""What matching found of depth, and where the receiver's depth differs from it."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

DIFFERENCE_SCALE = 10.0  # differences of relative disparity are a few hundredths


@dataclass(frozen=True)
class MatchedDepth:
    """Depth that an extractor read off the photographs before fusion; item = (batch view), no gradient.

    agreement: in [0, 1], of other views with it; 0 where nothing confirms it.
    """

    relative_disparity: Float[Tensor, "item 1 h4 w4"]
    agreement: Float[Tensor, "item 1 h4 w4"]


def depth_feedback(matched: MatchedDepth, decoded: Float[Tensor, "item 1 h4 w4"]) -> Float[Tensor, "item 2 h4 w4"]:
    """What E_fb is told of depth: where views agree, its difference to the decoded relative disparity; the agreement.

    A view's own Gaussians look right from where it stands whatever their depth, so that renderings say little of it.
    """
    difference = DIFFERENCE_SCALE * (matched.relative_disparity - decoded)
    return torch.cat((matched.agreement * difference, matched.agreement), dim=1).detach()
