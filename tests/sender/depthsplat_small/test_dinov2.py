"""The monocular branch starts from DINOv2 ViT-S/14, and computes what an independent implementation does."""

from pathlib import Path

import numpy as np
import pytest
import torch
from independent_vit import made_up_image, vit_features
from public_network import made_up_tensor, undrawn
from safetensors.torch import save_file
from torch import Tensor

from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

LARGEST_DIFFERENCE = 1e-4  # relative rms


@pytest.fixture(scope="module")
def extractor() -> DepthSplatSmall:
    with undrawn():
        return DepthSplatSmall().eval().requires_grad_(False)


def dinov2_names(extractor: DepthSplatSmall) -> dict[str, str]:
    """Our names of the tensors by the names that files of DINOv2 have."""
    names = {}
    for own in extractor.pretrained.state_dict():
        name = own.replace("attn.proj", "attention.output").replace("attn.", "attention.")
        name = name.replace("ls1.gamma", "layer_scale1").replace("ls2.gamma", "layer_scale2")
        name = name.replace("cls_token", "class_token").replace("pos_embed", "position_embedding")
        names[name.replace("patch_embed.proj", "patch_embedding")] = own
    return names


@pytest.fixture(scope="module")
def weights(extractor: DepthSplatSmall) -> dict[str, Tensor]:
    shapes = {name: extractor.pretrained.state_dict()[own].shape for name, own in dinov2_names(extractor).items()}
    return {name: made_up_tensor(name, list(shape)).half() for name, shape in shapes.items()}


def relative_rms(extractor: DepthSplatSmall, image: np.ndarray, expected: np.ndarray) -> float:
    mean, deviation = (torch.tensor(v)[:, None, None] for v in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)))
    with torch.no_grad():
        found = extractor.pretrained(((torch.from_numpy(image).float() - mean) / deviation)[None])[0].numpy()
    difference = found.astype(np.float64) - expected
    return float(np.sqrt((difference**2).mean() / (expected.astype(np.float64) ** 2).mean()))


def test_a_file_of_dinov2_fills_the_monocular_branch_alone(
    extractor: DepthSplatSmall, weights: dict[str, Tensor], tmp_path: Path
) -> None:
    path = tmp_path / "dinov2.safetensors"
    save_file(weights | {"mask_token": torch.zeros(1, 384)}, path)
    before = extractor.backbone.conv1.weight.clone()
    report = load_public_weights(extractor, path)
    assert len(report.used) == len(weights) and report.unused == ("mask_token",)
    assert all(name.startswith("pretrained.") for name in report.used)
    assert str(report).startswith("174 tensors used, 1 unused, ") and "(backbone, regressor" in str(report)
    own = extractor.pretrained.state_dict()
    assert all(torch.equal(own[name], weights[stored].float()) for stored, name in dinov2_names(extractor).items())
    assert torch.equal(extractor.backbone.conv1.weight, before)
    image = made_up_image(42, 56)
    expected = vit_features({name: value.numpy() for name, value in weights.items()}, image)
    assert relative_rms(extractor, image, expected) < LARGEST_DIFFERENCE
