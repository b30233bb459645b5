"""Weights of other networks, as they are published, fill all of the extractor but its fusion."""

from pathlib import Path

import pytest
import torch

from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

SHARED = Path(__file__).parents[4] / "shared" / "weights"
GMFLOW, DINOV2 = (SHARED / f"{name}.safetensors" for name in ("gmflow_refine", "dinov2_vits14"))


@pytest.mark.skipif(not (GMFLOW.is_file() and DINOV2.is_file()), reason="needs `shared`")
def test_two_files_fill_all_but_the_fusion() -> None:
    torch.manual_seed(0)
    extractor = DepthSplatSmall()
    of_dino, of_gmflow = (load_public_weights(extractor, path) for path in (DINOV2, GMFLOW))
    assert of_dino.unused == () and {name.split(".")[0] for name in of_dino.used} == {"pretrained"}
    unused = {name.split(".")[0] for name in of_gmflow.unused}
    assert unused == {"feature_flow_attn", "upsampler"}
    left = set(of_dino.missing) & set(of_gmflow.missing)
    assert {name.split(".")[0] for name in left} == {"regressor", "regressor_residual"}
