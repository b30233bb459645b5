"""Public checkpoints by name: official ones whole, initialisations in part, everything else refused."""

from pathlib import Path

import pytest
import torch
import torch.nn.functional as F
from public_network import SHAPES, made_up_weights, undrawn
from safetensors.torch import save_file
from torch import Tensor

from fecocodec.config import PaperSenderConfig
from fecocodec.errors import ModelError
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall


@pytest.fixture(scope="module")
def weights() -> dict[str, Tensor]:
    return made_up_weights()


@pytest.fixture(scope="module")
def extractor() -> DepthSplatSmall:
    """Each test loads weights."""
    with undrawn():
        return DepthSplatSmall()


def official(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """As published: the prefix, and modules that this extractor has no use for."""
    others = {
        "encoder.depth_predictor.depth_head.0.0.bias": torch.zeros(256),
        "encoder.gaussian_head.0.bias": torch.zeros(8),
    }
    return {f"encoder.depth_predictor.{name}": value for name, value in weights.items()} | others


def saved(path: Path, contents: object) -> Path:
    torch.save(contents, path)
    return path


@pytest.mark.parametrize("nest", [lambda tensors: tensors, lambda tensors: {"state_dict": tensors, "step": 3}])
def test_official_checkpoints_load_whole(
    extractor: DepthSplatSmall, weights: dict[str, Tensor], nest, tmp_path: Path
) -> None:
    report = load_public_weights(extractor, saved(tmp_path / "depthsplat.pth", nest(official(weights))))
    assert set(report.used) == set(SHAPES) and report.missing == ()
    assert report.unused == ("encoder.depth_predictor.depth_head.0.0.bias", "encoder.gaussian_head.0.bias")
    assert all(torch.equal(value, weights[name]) for name, value in extractor.state_dict().items())
    assert str(report) == f"{len(SHAPES)} tensors used, 2 unused, 0 missing"


def test_depth_anything_initialises_the_monocular_branch(
    extractor: DepthSplatSmall, weights: dict[str, Tensor], tmp_path: Path
) -> None:
    before = extractor.backbone.conv1.weight.clone()
    part = {name: value for name, value in weights.items() if name.startswith("pretrained.")}
    contents = part | {"pretrained.mask_token": torch.zeros(1, 384), "depth_head.scratch.bias": torch.zeros(3)}
    report = load_public_weights(extractor, saved(tmp_path / "depth_anything_v2_vits.pth", contents))
    assert set(report.used) == set(part) and report.unused == ("pretrained.mask_token", "depth_head.scratch.bias")
    assert torch.equal(extractor.pretrained.cls_token, weights["pretrained.cls_token"])
    assert torch.equal(extractor.backbone.conv1.weight, before)
    assert str(report).endswith("missing (backbone, regressor, regressor_residual, transformer)")


def test_a_file_of_dinov2_fills_the_monocular_branch_alone(
    extractor: DepthSplatSmall, weights: dict[str, Tensor], tmp_path: Path
) -> None:
    """Under the names of Transformers, as `.safetensors`, in fp16."""
    stored = {}
    for own in (name for name in weights if name.startswith("pretrained.")):
        name = own.removeprefix("pretrained.").replace("attn.proj", "attention.output").replace("attn.", "attention.")
        name = name.replace("ls1.gamma", "layer_scale1").replace("ls2.gamma", "layer_scale2")
        name = name.replace("cls_token", "class_token").replace("pos_embed", "position_embedding")
        stored[name.replace("patch_embed.proj", "patch_embedding")] = own
    path = tmp_path / "dinov2.safetensors"
    tensors = {name: weights[own].half() for name, own in stored.items()}
    save_file(tensors | {"mask_token": torch.zeros(1, 384)}, path)
    before = extractor.backbone.conv1.weight.clone()
    report = load_public_weights(extractor, path)
    assert set(report.used) == set(stored.values()) and report.unused == ("mask_token",)
    assert str(report).startswith("174 tensors used, 1 unused, ") and "(backbone, regressor" in str(report)
    own_tensors = extractor.state_dict()
    assert all(torch.equal(own_tensors[own], tensors[name].float()) for name, own in stored.items())
    assert torch.equal(extractor.backbone.conv1.weight, before)


def test_the_last_convolution_of_a_cnn_of_two_scales_becomes_part_of_the_one_before_it(
    extractor: DepthSplatSmall, weights: dict[str, Tensor], tmp_path: Path
) -> None:
    """On constant features, 1x1 and 3x3 convolution are their product; both parts of the table are named."""
    part = {name: value for name, value in weights.items() if name.split(".")[0] in ("backbone", "transformer")}
    trident = torch.randn(128, 128, 3, 3, generator=torch.Generator().manual_seed(0)) / 30
    others = {"backbone.trident_conv.weight": trident, "upsampler.0.bias": torch.zeros(256)}
    report = load_public_weights(extractor, saved(tmp_path / "gmflow.pth", {"model": part | others}))
    assert set(report.used) == set(part) and report.unused == ("upsampler.0.bias",)
    constant = torch.linspace(-1, 1, 128).view(1, 128, 1, 1).expand(1, 128, 5, 5)
    before = F.conv2d(constant, weights["backbone.conv2.weight"], weights["backbone.conv2.bias"])
    expected = F.conv2d(before, trident)[..., :1, :1]
    torch.testing.assert_close(extractor.backbone.conv2(constant)[..., :1, :1], expected, atol=1e-4, rtol=1e-4)
    assert [row.split() for row in report.table()] == [
        ["part", "used", "unused", "missing"],
        ["backbone", "19", "0", "0"],
        ["pretrained", "0", "0", "174"],
        ["regressor", "0", "0", "138"],
        ["regressor_residual", "0", "0", "2"],
        ["transformer", "96", "0", "0"],
        ["upsampler", "0", "1", "0"],
    ]


def test_official_checkpoints_need_the_public_geometry_and_initialisations_do_not(
    weights: dict[str, Tensor], tmp_path: Path
) -> None:
    path = saved(tmp_path / "depthsplat.pth", official(weights))
    with pytest.raises(ModelError, match="was trained with the public code's geometry, this extractor has 'exact'"):
        load_public_weights(DepthSplatSmall(geometry="exact"), path)
    assert PaperSenderConfig().geometry == DepthSplatSmall().geometry == "public"
    part = saved(tmp_path / "part.pth", {"pretrained.cls_token": weights["pretrained.cls_token"]})
    assert load_public_weights(DepthSplatSmall(geometry="exact"), part).used == ("pretrained.cls_token",)


def test_refusals(extractor: DepthSplatSmall, weights: dict[str, Tensor], tmp_path: Path) -> None:
    path = tmp_path / "weights.pth"
    with pytest.raises(ModelError, match="no such checkpoint"):
        load_public_weights(extractor, path)
    path.write_bytes(b"PK not a checkpoint")
    with pytest.raises(ModelError, match="no checkpoint, damaged, or with more than tensors in it"):
        load_public_weights(extractor, path)
    with pytest.raises(ModelError, match=r"store its state_dict alone with torch\.save"):
        load_public_weights(extractor, saved(path, {"state_dict": {}, "callback": pytest.raises}))
    with pytest.raises(ModelError, match="no tensor of it belongs to depthsplat-small"):
        load_public_weights(extractor, saved(path, {"conv.weight": torch.zeros(3)}))
    whole = official(weights)
    del whole["encoder.depth_predictor.pretrained.cls_token"]
    with pytest.raises(ModelError, match=r"lacks 1 tensors such as pretrained\.cls_token"):
        load_public_weights(extractor, saved(path, whole))
    with pytest.raises(ModelError, match=r"pretrained\.cls_token is \(1, 1, 768\), but \(1, 1, 384\) here"):
        load_public_weights(extractor, saved(path, {"pretrained.cls_token": torch.zeros(1, 1, 768)}))
