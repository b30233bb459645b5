"""Tensor by tensor and number by number the public network, up to its fused features."""

from pathlib import Path

import pytest
import torch
from public_network import FULL, SHAPES, SHIPPED, made_up_extractor, read_reference

from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall


@pytest.fixture(scope="module")
def extractor() -> DepthSplatSmall:
    return made_up_extractor()


def test_tensors_have_the_public_names_and_shapes(extractor: DepthSplatSmall) -> None:
    assert {name: list(value.shape) for name, value in extractor.state_dict().items()} == SHAPES


@pytest.mark.parametrize("path", [
    pytest.param(SHIPPED, id="shipped"),
    pytest.param(FULL, id="full", marks=pytest.mark.skipif(not FULL.is_file(), reason="needs every 4th channel")),
])  # fmt: skip
def test_every_branch_gives_the_public_numbers(extractor: DepthSplatSmall, path: Path) -> None:
    reference = read_reference(path)
    with torch.inference_mode():
        evidence = extractor.match(reference.images, reference.cameras)
        found = {
            "features_cnn": evidence.appearance,
            "features_mv": evidence.multi_view,
            "features_mono": evidence.monocular,
            "cost_volume": evidence.cost,
            "f1": extractor.fuse(reference.images, evidence),
        }
    assert found.keys() == reference.outputs.keys()
    for name, expected in reference.outputs.items():
        difference = reference.thinned(found[name]) - expected
        assert difference.norm() < 1e-5 * expected.norm(), name  # the bound is 1e-4; measured 1e-6
        assert difference.abs().max() < 1e-4 * expected.abs().max(), name
