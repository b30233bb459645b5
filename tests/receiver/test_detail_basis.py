"""Detail is added to the raw outputs of the head, block by block, and weights files keep its basis and tables."""

from pathlib import Path

import pytest
import torch

from fecocodec.config import PAPER, ReceiverConfig
from fecocodec.errors import ModelError
from fecocodec.grid import PER_BLOCK
from fecocodec.receiver.model import DetailBasis, Receiver, load_receiver, serialise_receiver
from fecocodec.splatting.attributes import RAW
from tests.example_scenes import example_views

PLANES = 3
CONFIG = ReceiverConfig(detail_planes=PLANES)


def test_numbers_of_a_block_change_its_own_gaussians() -> None:
    basis = DetailBasis(CONFIG)
    values = torch.randn(2, PLANES, 2, 3, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        added = basis(values)
    assert added.shape == (2, sum(RAW.values()), 2 * PER_BLOCK, 3 * PER_BLOCK)
    for view, output, row, column in ((0, 0, 0, 0), (1, 13, 7, 11), (0, 5, 4, 2), (1, 3, 2, 9)):
        place = ((row % PER_BLOCK) * PER_BLOCK + column % PER_BLOCK) * sum(RAW.values()) + output
        expected = sum(
            float(values[view, plane, row // PER_BLOCK, column // PER_BLOCK])
            * float(basis.basis[plane, place].detach())
            for plane in range(PLANES)
        )
        assert float(added[view, output, row, column]) == pytest.approx(expected, abs=1e-6)


@torch.no_grad()
def test_zeros_change_nothing_and_other_numbers_do() -> None:
    torch.manual_seed(0)
    receiver, cameras = Receiver(CONFIG).eval(), example_views(2).cameras.as_batch()
    state, condition = torch.randn(2, CONFIG.state_channels, 16, 16), receiver.condition(torch.tensor([900, 900]), 2)
    values = torch.zeros(2, PLANES, 8, 8)
    plain, zeros = (
        receiver.predict(state, cameras, condition, detail).attributes.gaussians() for detail in (None, values)
    )
    values[1, 0, 2, 3] = 5.0
    changed = receiver.predict(state, cameras, condition, values).attributes.gaussians()
    for before, after in zip(plain.fields(), zeros.fields(), strict=True):
        assert torch.equal(before, after)
    moved = (changed.means != plain.means).any(dim=-1)[0].view(2, 32, 32)
    assert moved[1, 8:12, 12:16].all()
    assert int(moved.sum()) == PER_BLOCK**2


def test_a_model_without_detail_refuses_it() -> None:
    receiver, cameras = Receiver(ReceiverConfig()), example_views(2).cameras.as_batch()
    state, condition = torch.zeros(2, 128, 16, 16), receiver.condition(torch.tensor([900, 900]), 2)
    with pytest.raises(ModelError, match="has no detail layer"):
        receiver.predict(state, cameras, condition, torch.zeros(2, PLANES, 8, 8))
    with pytest.raises(ModelError, match="no detail layer"):
        Receiver(ReceiverConfig(method=PAPER, detail_planes=PLANES))


def test_weights_files_keep_basis_and_tables(tmp_path: Path) -> None:
    receiver = Receiver(CONFIG)
    assert receiver.detail is not None
    receiver.detail.tables.copy_(torch.arange(PLANES * 16).view(PLANES, 16))
    path = tmp_path / "receiver.safetensors"
    path.write_bytes(serialise_receiver(receiver))
    loaded, _ = load_receiver(path)
    assert loaded.detail is not None
    assert loaded.detail.tables.dtype == torch.uint8
    assert torch.equal(loaded.detail.tables, receiver.detail.tables)
    assert torch.equal(loaded.detail.basis, receiver.detail.basis.half().float())
