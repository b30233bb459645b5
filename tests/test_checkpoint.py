"""Weights files: round trip, and errors for missing and damaged files."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load, save

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, find_receiver, read_weights, serialise_weights
from fecocodec.config import ReceiverConfig, stored_fields
from fecocodec.errors import ModelError
from fecocodec.receiver.model import load_receiver, serialise_receiver
from fecocodec.sender.codec import load_codec, load_sender
from tests.example_scenes import MODEL


@pytest.fixture
def model(random_weights: Path, tmp_path: Path) -> Path:
    """A copy of the model's folder that a test may damage."""
    return Path(shutil.copytree(random_weights / MODEL, tmp_path / "weights" / MODEL))


def rewrite(path: Path, tensors: dict[str, torch.Tensor], config: object) -> None:
    path.write_bytes(save(tensors, metadata={"config": json.dumps(config)}))


def test_floats_come_back_as_float32_and_integers_as_they_were(tmp_path: Path) -> None:
    tensors = {"real": torch.tensor([0.5, -3.0]), "whole": torch.tensor([7, -7], dtype=torch.int16)}
    (tmp_path / "file").write_bytes(serialise_weights(tensors, {"receiver": {"width": 3}}))
    weights = read_weights(tmp_path / "file")
    assert weights.tensors["real"].dtype == torch.float32 and weights.tensors["whole"].dtype == torch.int16
    assert all(torch.equal(weights.tensors[name], value) for name, value in tensors.items())
    assert weights.config == {"receiver": {"width": 3}} and len(weights.model_id) == 8


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e5])
def test_floats_that_fp16_cannot_hold_are_refused(value: float) -> None:
    tensors = {"fine": torch.zeros(3), "wild": torch.tensor([65504.0, value])}
    with pytest.raises(ModelError, match=r"tensor 'wild': it holds NaN or values beyond the 65504 of fp16; export"):
        serialise_weights(tensors, {})


def test_a_receiver_written_again_is_the_same_file(model: Path) -> None:
    receiver, model_id = load_receiver(model / RECEIVER_FILE)
    assert serialise_receiver(receiver) == (model / RECEIVER_FILE).read_bytes()
    assert find_receiver(model_id, model) == model / RECEIVER_FILE


def test_an_unknown_model_id_is_named_with_the_place_and_the_models_there(model: Path) -> None:
    with pytest.raises(ModelError, match=f"model id {b'unknown!'.hex()}, but {model} has {MODEL}; install"):
        find_receiver(b"unknown!", model)
    empty = model.parent / "empty"
    with pytest.raises(ModelError, match="nowhere: there is no such folder"):
        find_receiver(b"unknown!", model.parent / "nowhere")
    empty.mkdir()
    with pytest.raises(ModelError, match="has none"):
        find_receiver(b"unknown!", empty)


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "noise", "no configuration", "folder"])
def test_a_file_that_is_missing_or_damaged_is_named(model: Path, damage: str) -> None:
    path = model / RECEIVER_FILE
    data = path.read_bytes()
    path.unlink()
    if damage == "folder":
        path.mkdir()
    elif damage != "missing":
        contents = {"empty": b"", "cut": data[: len(data) // 2], "noise": bytes(range(256)) * 40}
        path.write_bytes(contents.get(damage) or (b"" if damage == "empty" else save(load(data))))
    with pytest.raises(ModelError, match=r"receiver\.safetensors: .*reinstall the package\.$"):
        load_receiver(path)


@pytest.mark.parametrize("lost", ["predictor.depth_head.weight", "prior.hyper_prior.bias"])
def test_a_missing_tensor_is_an_error(model: Path, lost: str) -> None:
    path = model / RECEIVER_FILE
    weights = read_weights(path)
    tensors = {name: value for name, value in weights.tensors.items() if name != lost}
    path.write_bytes(serialise_weights(tensors, weights.config))
    with pytest.raises(ModelError):
        load_receiver(path)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({}, "holds no receiver"),
        ([], "no JSON object"),
        ({"receiver": {"state_channels": 128}}, "another version"),
        ({"receiver": {"unknown": 1}}, "another version"),
        ({"receiver": "large"}, "holds no receiver"),
        ({"receiver": stored_fields(ReceiverConfig()) | {"predictor_channels": "wide"}}, "another version"),
    ],
)
def test_a_configuration_that_does_not_fit_is_an_error(model: Path, config: object, message: str) -> None:
    path = model / RECEIVER_FILE
    rewrite(path, load(path.read_bytes()), config)
    with pytest.raises(ModelError, match=message):
        load_receiver(path)


def test_the_ends_cannot_be_mistaken_for_each_other(model: Path) -> None:
    with pytest.raises(ModelError, match="holds no sender; name a sender's weights file"):
        load_sender(model / RECEIVER_FILE, ReceiverConfig(), b"any")
    with pytest.raises(ModelError, match="holds no receiver"):
        load_receiver(model / SENDER_FILE)


def test_a_sender_of_another_receiver_is_refused(random_weights: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mixed"
    shutil.copytree(random_weights / MODEL, folder)
    receiver, _ = load_receiver(folder / RECEIVER_FILE)
    receiver.update.initial_state += 1.0
    (folder / RECEIVER_FILE).write_bytes(serialise_receiver(receiver))
    with pytest.raises(ModelError, match=r"sender\.safetensors: this sender was made for the receiver"):
        load_codec(folder, "cpu")
