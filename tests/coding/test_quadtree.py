"""The quadtree codes each element of a latent once, in the order of DCVC-DC."""

import torch

from fecocodec.coding.quadtree import (
    from_coding_order,
    merge_phases,
    neighbourhoods,
    phase_neighbourhoods,
    split_phases,
    to_coding_order,
)


def test_coding_order_is_a_permutation_with_an_inverse():
    y = torch.arange(2 * 32 * 8 * 12).view(2, 32, 8, 12).double()
    coded = to_coding_order(y)
    assert coded.shape == (4, 4, 2, 4, 6, 8)
    assert torch.equal(coded.flatten().sort().values, y.flatten())
    assert torch.equal(from_coding_order(coded), y)


def test_split_and_merge_are_inverse():
    x = torch.randn(3, 4, 6, 5)
    assert torch.equal(merge_phases(split_phases(x)), x)
    assert torch.equal(split_phases(x)[1], x[:, 0::2, 1::2])
    assert torch.equal(split_phases(x)[2], x[:, 1::2, 0::2])


def test_neighbourhoods_are_those_of_unfold():
    x = torch.randn(2, 5, 3, 4)
    unfolded = torch.nn.functional.unfold(x.permute(0, 3, 1, 2), 3, padding=1)
    expected = unfolded.view(2, 4, 9, 5, 3).permute(0, 3, 4, 2, 1).reshape(2, 5, 3, 36)
    assert torch.equal(neighbourhoods(x), expected)


def test_gradients_of_neighbourhoods():
    x = torch.randn(2, 4, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(neighbourhoods, x)
    assert torch.autograd.gradcheck(phase_neighbourhoods, x)
