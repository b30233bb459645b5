"""Gradients of what the entropy model sees of decoded neighbours; `test_payload` checks the values."""

import torch

from fecocodec.coding.quadtree import (
    neighbourhoods,
    phase_neighbourhoods,
)


def test_gradients_of_neighbourhoods():
    x = torch.randn(2, 4, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(neighbourhoods, x)
    assert torch.autograd.gradcheck(phase_neighbourhoods, x)
