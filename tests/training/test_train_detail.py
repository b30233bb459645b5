"""The fit of the detail layer finds the directions that matter, and tables that cost the fewest bits."""

import numpy as np
import pytest
import torch

from fecocodec.coding.detail import buckets, encode_detail
from fecocodec.container import quantise_lambda
from fecocodec.entropy.tables import FIRST_CODED_TABLE
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import write_stages
from fecocodec.sender.optimisation_config import DEFAULT, FAST
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.training import train_detail
from fecocodec.training.train_detail import (
    LAMBDAS_OF_DETAIL,
    LAST_MAGNITUDE,
    SIZE,
    Coded,
    basis_of,
    best_tables,
    fit_tables,
    replaced,
    with_detail,
)
from tests.example_scenes import example_views

PLANES = 5


@pytest.fixture(scope="module")
def coded(codec: Codec) -> list[Coded]:
    with torch.no_grad():
        scene = prepare_scene(example_views(2), codec.device)
        encoder = SceneEncoder(codec, scene.images, scene.cameras)
        return [(encoder, write_stages(encoder, quantise_lambda(1e-3), 2, FAST)[-1])]


@pytest.fixture(scope="module")
def basis(coded: list[Coded]) -> torch.Tensor:
    return basis_of(coded, PLANES)


def test_components_are_orthogonal_where_outputs_matter_alike(codec: Codec, basis: torch.Tensor) -> None:
    assert basis.shape == (PLANES, 224)
    assert bool(basis.isfinite().all())
    scaled = basis.view(PLANES, 16, 14)
    sensitivity = 1.0 / scaled.square().sum(dim=(0, 1)).sqrt()  # up to a factor; each output has its own scale
    assert float(sensitivity.max() / sensitivity.min()) > 1.5
    receiver = with_detail(codec.receiver, basis)
    assert receiver.config.detail_planes == PLANES
    assert torch.equal(receiver.detail_basis.basis, basis.half().float())
    for name, value in codec.receiver.state_dict().items():
        assert torch.equal(receiver.state_dict()[name], value)


def test_best_tables_follow_the_counts() -> None:
    counts = np.zeros((2, 16, LAST_MAGNITUDE + 1), np.int64)
    counts[0, :, 0], counts[0, :, 1] = 1000, 1  # nearly always 0
    counts[1, :, :] = 100  # wide
    tables = best_tables(np.repeat(counts, 8, axis=0))
    assert tables.dtype == np.uint8
    assert int(tables[0].max()) <= FIRST_CODED_TABLE
    assert int(tables[-1].min()) > 30


def test_best_tables_need_fewer_bytes_than_one_table_for_all() -> None:
    generator = np.random.default_rng(0)
    spread = np.repeat(np.repeat(generator.gamma(0.3, 2.0, (1, 6, 6)), 4, axis=1), 4, axis=2)
    symbols = np.rint(generator.laplace(size=(8, 1, 24, 24)) * spread).astype(np.int32)
    found = buckets(symbols)
    counts = np.zeros((8, 16, LAST_MAGNITUDE + 1), np.int64)
    np.add.at(counts, (np.arange(8)[:, None, None, None], found, np.minimum(np.abs(symbols), LAST_MAGNITUDE)), 1)
    fitted = best_tables(counts)
    sizes = []
    for tables in (np.maximum(fitted, FIRST_CODED_TABLE), np.full((8, 16), 22, np.uint8)):
        payload, coded = encode_detail(tables, lambda plane, _tables: symbols[plane], (1, 24, 24))
        assert np.array_equal(coded, symbols)
        sizes.append(len(payload))
    assert sizes[0] < 0.9 * sizes[1]


def test_tables_are_fitted_at_lambdas_that_have_detail(
    codec: Codec, coded: list[Coded], basis: torch.Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = 2 * SIZE[0] * SIZE[1]
    assert all(DEFAULT.detail_steps_of(2, pixels, quantise_lambda(lmbda)) > 0 for lmbda in LAMBDAS_OF_DETAIL)
    monkeypatch.setattr(train_detail, "LAMBDAS_OF_DETAIL", LAMBDAS_OF_DETAIL[1:3])
    receiver = with_detail(codec.receiver, basis)
    before = receiver.detail_basis.tables.clone()
    fit_tables(receiver, [(replaced(encoder, receiver), last) for encoder, last in coded])
    assert not torch.equal(receiver.detail_basis.tables, before)
