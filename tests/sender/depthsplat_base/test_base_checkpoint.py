"""Checkpoints of DepthSplat-Base: official ones load by name, and senders find theirs again."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from public_base_network import SHAPES, constant_weights, shapes_at_8, write_checkpoint
from torch import Tensor

from fecocodec.checkpoint import SENDER_FILE
from fecocodec.config import PAPER_RECEIVER, LargeSenderConfig
from fecocodec.errors import InputError, ModelError
from fecocodec.sender.codec import load_frozen_extractor, load_sender, serialise_sender
from fecocodec.sender.extractors.depthsplat_base.dpt_head import DptHead
from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender
from tests.example_scenes import example_views
from tests.sender.depthsplat_small.public_network import undrawn

MODEL_ID = bytes(8)


@pytest.fixture(scope="module")
def network() -> DepthSplatBase:
    with undrawn():
        return DepthSplatBase()


def test_official_checkpoints_load_by_name(network: DepthSplatBase, tmp_path: Path) -> None:
    report = load_public_weights(network, write_checkpoint(tmp_path / "base.pth"))
    assert set(report.used) == set(SHAPES) and report.unused == ("encoder.gaussian_head.0.bias",)
    expected = constant_weights()
    assert all(torch.equal(value, expected[f"encoder.{name}"]) for name, value in network.state_dict().items())
    assert not any(parameter.requires_grad for parameter in network.parameters())
    assert [row.split()[:2] for row in report.table()][1:4] == [["backbone", "19"], ["depth_head", "8"], [
        "feature_upsampler", "60",
    ]]  # fmt: skip


def test_checkpoints_that_match_at_an_eighth_are_told_by_their_shapes(network: DepthSplatBase, tmp_path: Path) -> None:
    """Also after one of the other kind, and the other way round."""
    fine = write_checkpoint(tmp_path / "base.pth")
    coarse, expected = tmp_path / "coarse.pth", constant_weights(shapes=shapes_at_8())
    torch.save(expected, coarse)
    for path, lowest, strides in ((coarse, 8, (2, 2)), (fine, 4, (1, 1)), (coarse, 8, (2, 2))):
        load_public_weights(network, path)
        predictor = network.depth_predictor
        assert predictor.lowest == lowest and predictor.backbone.layer2[0].conv1.stride == strides
    assert all(torch.equal(value, expected[f"encoder.{name}"]) for name, value in network.state_dict().items())
    views = example_views(2, 64, 96)
    with torch.inference_mode():
        assert network.features(views.images[None], views.cameras.as_batch()).shape == (1, 2, 96, 64, 96)
        maps = network.maps(views.images[None], views.cameras.as_batch())
        depth, (coarse_scale, fine_scale) = network.depth_predictor.depth(maps, views.cameras.as_batch())
    assert depth.shape == (2, 64, 96) and coarse_scale.shape == (2, 128, 8, 12) and fine_scale.shape == (2, 32, 16, 24)
    small = example_views(2, 48, 80)
    with pytest.raises(InputError, match="pad to multiples of 32"):
        network.features(small.images[None], small.cameras.as_batch())


@pytest.mark.parametrize("lowest", [4, 8])
def test_the_head_joins_maps_in_the_public_order(lowest: int) -> None:
    """Next to each scale of matching are the features of the CNN and the transformer; depth is at the finer scale."""
    head, sides = DptHead(48, lowest, predicts_depth=True), {1: 16, 2: 8, 3: 4}  # of 32 pixels
    finer = 1 if lowest == 4 else 2
    images = [torch.randn(1, channels, sides[level], sides[level]) for channels, level in (
        (64, 1), (96, finer), (128, finer + 1), (128, finer + 1), (64, finer), (1, finer),
    )]  # fmt: skip
    first, second, third, coarse, fine, depth = images
    joined: list[Tensor] = []
    for project in head.concat_projects:
        project.register_forward_pre_hook(lambda module, inputs: joined.append(inputs[0]))
    head([torch.randn(1, 768, 4, 4) for _ in range(4)], (first, second, third), (coarse, fine), (depth,))
    if lowest == 4:
        assert torch.equal(joined[0][:, :225], torch.cat((first, second, fine, depth), dim=1))
        assert torch.equal(joined[1][:, :128], third) and torch.equal(joined[1][:, -128:], coarse)
    else:
        assert torch.equal(joined[0][:, :64], first)
        assert torch.equal(joined[1][:, :96], second)
        assert torch.equal(joined[1][:, -65:], torch.cat((fine, depth), dim=1))
        assert torch.equal(joined[2][:, :128], third) and torch.equal(joined[2][:, -128:], coarse)


def test_other_checkpoints_are_refused(network: DepthSplatBase, tmp_path: Path) -> None:
    path, whole = tmp_path / "base.pth", constant_weights()
    torch.save({name: value for name, value in whole.items() if "feature_upsampler" not in name}, path)
    with pytest.raises(
        ModelError, match=r"base.pth: lacks 60 tensors such as feature_up\S+; fetch that of depthsplat-base\.$"
    ):
        load_public_weights(network, path)
    torch.save(whole | {"encoder.depth_predictor.pretrained.cls_token": torch.zeros(1, 1, 384)}, path)
    with pytest.raises(
        ModelError, match=r"cls_token is \(1, 1, 384\), but \(1, 1, 768\) here; take .* of the base variant\.$"
    ):
        load_public_weights(network, path)
    small = {f"encoder.depth_predictor.{name}": value for name, value in DepthSplatSmall().state_dict().items()}
    torch.save(small, path)
    with pytest.raises(ModelError, match=r"lacks \d+ tensors such as depth_predictor"):
        load_public_weights(network, path)
    torch.save(whole, path)
    with pytest.raises(ModelError, match=r"but .* here; take the weights of the small variant"):
        load_public_weights(DepthSplatSmall(), path)


def trained_sender(model: Path, checkpoint: Path) -> Sender:
    sender = Sender(LargeSenderConfig(), PAPER_RECEIVER)
    load_frozen_extractor(sender, checkpoint)
    model.mkdir()
    (model / SENDER_FILE).write_bytes(serialise_sender(sender, MODEL_ID))
    return sender


@undrawn()
def test_a_sender_finds_its_extractor_where_it_was_or_beside_its_file(tmp_path: Path) -> None:
    checkpoint, file = write_checkpoint(tmp_path / "base.pth"), tmp_path / "model" / SENDER_FILE
    sender = trained_sender(tmp_path / "model", checkpoint)
    assert file.stat().st_size < 10e6 and not any("frozen" in name for name in sender.state_dict())
    loaded = load_sender(file, PAPER_RECEIVER, MODEL_ID)
    assert loaded.config == sender.config  # with the fingerprint
    checkpoint.rename(file.parent / "base.pth")
    moved = load_sender(file, PAPER_RECEIVER, MODEL_ID)
    assert moved.config == replace(sender.config, weights=str(file.parent.resolve() / "base.pth"))
    write_checkpoint(file.parent / "base.pth", seed="other")
    with pytest.raises(ModelError, match=r"base.pth: its tensors are depthsplat-base-\w+, but .* was trained with dep"):
        load_sender(file, PAPER_RECEIVER, MODEL_ID)
    (file.parent / "base.pth").unlink()
    absent = r"needs the weights of its extractor, base.pth \(depthsplat-base-\w{16}\), which are not at .*base.pth"
    with pytest.raises(ModelError, match=f"{absent}; put that file into the model's folder"):
        load_sender(file, PAPER_RECEIVER, MODEL_ID)
