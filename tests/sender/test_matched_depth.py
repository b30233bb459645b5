"""Depth feedback for stage 2."""

import torch

from fecocodec.sender.matched_depth import DIFFERENCE_SCALE, MatchedDepth, depth_feedback

MATCHED = torch.full((1, 1, 4, 4), 0.6)


def test_a_decoded_depth_that_is_too_far_counts_as_positive_where_views_agree() -> None:
    consistency = torch.zeros(1, 1, 4, 4)
    consistency[..., :2] = 1.0
    feedback = depth_feedback(MatchedDepth(MATCHED, consistency), torch.full((1, 1, 4, 4), 0.5))
    torch.testing.assert_close(feedback[0, 0, :, :2], torch.full((4, 2), 0.1 * DIFFERENCE_SCALE))
    assert float(feedback[0, 0, :, 2:].abs().max()) == 0.0
    torch.testing.assert_close(feedback[:, 1:], consistency)


def test_no_gradient_reaches_matching_or_decoding_through_it() -> None:
    decoded = torch.full((1, 1, 4, 4), 0.5, requires_grad=True)
    assert not depth_feedback(MatchedDepth(MATCHED, torch.ones(1, 1, 4, 4)), decoded).requires_grad
