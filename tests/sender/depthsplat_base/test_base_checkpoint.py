"""Checkpoints of DepthSplat-Base: official ones load by name, and senders find theirs again."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from public_base_network import SHAPES, constant_weights, write_checkpoint

from fecocodec.checkpoint import SENDER_FILE
from fecocodec.config import PAPER_RECEIVER, LargeSenderConfig
from fecocodec.errors import ModelError
from fecocodec.sender.codec import load_frozen_extractor, load_sender, serialise_sender
from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender

MODEL_ID = bytes(8)


def test_official_checkpoints_load_by_name(tmp_path: Path) -> None:
    network = DepthSplatBase()
    report = load_public_weights(network, write_checkpoint(tmp_path / "base.pth"))
    assert set(report.used) == set(SHAPES) and report.unused == ("encoder.gaussian_head.0.bias",)
    expected = constant_weights()
    assert all(torch.equal(value, expected[f"encoder.{name}"]) for name, value in network.state_dict().items())
    assert not any(parameter.requires_grad for parameter in network.parameters())
    assert [row.split()[:2] for row in report.table()][1:4] == [["backbone", "19"], ["depth_head", "8"], [
        "feature_upsampler", "60",
    ]]  # fmt: skip


def test_other_checkpoints_are_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "base.pth", constant_weights()
    torch.save({name: value for name, value in whole.items() if "feature_upsampler" not in name}, path)
    with pytest.raises(
        ModelError, match=r"base.pth: lacks 60 tensors such as feature_up\S+; fetch that of depthsplat-base\.$"
    ):
        load_public_weights(DepthSplatBase(), path)
    torch.save(whole | {"encoder.depth_predictor.pretrained.cls_token": torch.zeros(1, 1, 384)}, path)
    with pytest.raises(
        ModelError, match=r"cls_token is \(1, 1, 384\), but \(1, 1, 768\) here; take .* of the base variant\.$"
    ):
        load_public_weights(DepthSplatBase(), path)
    small = {f"encoder.depth_predictor.{name}": value for name, value in DepthSplatSmall().state_dict().items()}
    torch.save(small, path)
    with pytest.raises(ModelError, match=r"lacks \d+ tensors such as depth_predictor"):
        load_public_weights(DepthSplatBase(), path)
    torch.save(whole, path)
    with pytest.raises(ModelError, match=r"but .* here; take the weights of the small variant"):
        load_public_weights(DepthSplatSmall(), path)


def trained_sender(model: Path, checkpoint: Path) -> Sender:
    sender = Sender(LargeSenderConfig(), PAPER_RECEIVER)
    load_frozen_extractor(sender, checkpoint)
    model.mkdir()
    (model / SENDER_FILE).write_bytes(serialise_sender(sender, MODEL_ID))
    return sender


def test_a_sender_finds_its_extractor_where_it_was_or_beside_its_file(tmp_path: Path) -> None:
    checkpoint, file = write_checkpoint(tmp_path / "base.pth"), tmp_path / "model" / SENDER_FILE
    sender = trained_sender(tmp_path / "model", checkpoint)
    assert file.stat().st_size < 10e6 and not any("frozen" in name for name in sender.state_dict())
    loaded = load_sender(file, PAPER_RECEIVER, MODEL_ID)
    assert loaded.config == sender.config and loaded.extractor.frozen.fingerprint() == sender.config.fingerprint
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
