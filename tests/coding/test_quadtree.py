"""The quadtree codes each element of a latent once, in the order of DCVC-DC."""

import torch

from fecocodec.coding.quadtree import (
    KNOWN_BLOCKS,
    blocks_around,
    from_coding_order,
    merge_passes,
    merge_phases,
    neighbourhoods,
    phase_neighbourhoods,
    split_passes,
    split_phases,
    to_coding_order,
)


def test_coding_order_is_a_permutation_with_an_inverse():
    y = torch.arange(2 * 32 * 8 * 12).view(2, 32, 8, 12).double()
    coded = to_coding_order(y)
    assert coded.shape == (4, 4, 2, 4, 6, 8)
    assert torch.equal(coded.flatten().sort().values, y.flatten())
    assert torch.equal(from_coding_order(coded), y)


def test_phases_of_each_step_and_quarter():
    """Step 1 codes m0 m1 m2 m3 for quarters g0..g3, step 2 m3 m2 m1 m0, step 3 m2 m3 m0 m1, step 4 m1 m0 m3 m2."""
    row, column = torch.arange(4).view(1, 1, 4, 1), torch.arange(4)
    phase = 2 * (row % 2) + column % 2
    quarter = torch.arange(32).view(1, 32, 1, 1) // 8
    coded = to_coding_order((10.0 * quarter + phase).expand(1, 32, 4, 4))
    phases = torch.full((4, 4), -1)
    for step in range(4):
        for value in coded[step].unique().int().tolist():
            phases[step, value // 10] = value % 10
    assert phases.tolist() == [[0, 1, 2, 3], [3, 2, 1, 0], [2, 3, 0, 1], [1, 0, 3, 2]]


def test_split_and_merge_are_inverse():
    x = torch.randn(3, 4, 6, 5)
    assert torch.equal(merge_phases(split_phases(x)), x)
    assert torch.equal(split_phases(x)[1], x[:, 0::2, 1::2])
    assert torch.equal(split_phases(x)[2], x[:, 1::2, 0::2])


def test_passes_cover_blocks_once_and_by_parity():
    x = torch.randn(4, 3, 6, 8, 5)
    first, second, rest = split_passes(x)
    assert torch.equal(merge_passes([first, second, rest]), x)
    row, column = torch.arange(6)[:, None], torch.arange(8)
    parity = (row % 2 + column % 2).view(6, 8, 1).float()
    assert [part.unique().tolist() for part in split_passes(parity)] == [[0.0], [2.0], [1.0]]
    assert torch.equal(rest[0, 0, 3], x[0, 0, 3, 0::2]) and torch.equal(rest[0, 0, 2], x[0, 0, 2, 1::2])


def test_passes_that_are_not_known_are_zero():
    x = torch.randn(2, 4, 4, 3)
    parts = split_passes(x)
    known = torch.zeros(4, 4, dtype=torch.bool)
    for number, parity in enumerate(((0, 0), (1, 1)), start=1):
        known[parity[0] :: 2, parity[1] :: 2] = True
        assert torch.equal(merge_passes(parts[:number]), x * known[..., None])


def test_known_blocks_are_those_of_earlier_passes():
    order = torch.full((6, 6, 1), -1.0)
    for number, part in enumerate(split_passes(torch.arange(36.0).view(6, 6, 1))):
        order.view(-1)[part.flatten().long()] = number
    for number, offsets in enumerate(KNOWN_BLOCKS):
        around = blocks_around(order[None] + 10.0, offsets) if offsets else torch.zeros(1, 6, 6, 0)
        of_pass = split_passes(around)[number]
        inside = of_pass[of_pass > 0] - 10.0
        assert (inside < number).all() and (number == 0 or len(inside))


def test_neighbourhoods_are_those_of_unfold():
    x = torch.randn(2, 5, 3, 4)
    unfolded = torch.nn.functional.unfold(x.permute(0, 3, 1, 2), 3, padding=1)
    expected = unfolded.view(2, 4, 9, 5, 3).permute(0, 3, 4, 2, 1).reshape(2, 5, 3, 36)
    assert torch.equal(neighbourhoods(x), expected)


def test_neighbourhoods_by_phase():
    x = torch.randn(2, 4, 6, 3)
    assert torch.equal(phase_neighbourhoods(x), split_phases(neighbourhoods(x)))


def test_gradients_of_neighbourhoods():
    x = torch.randn(2, 4, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(neighbourhoods, x)
    assert torch.autograd.gradcheck(phase_neighbourhoods, x)
