"""`fecosplat train entropy | steps | detail`: a finished model in, a new model out."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, SENDER_FILE
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import load_codec
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import DEFAULT, FAST
from fecocodec.training.model_weights import write_model
from tests.cli.conftest import CommandLine
from tests.training.tiny_runs import changed, copied

VERBS = ("entropy", "steps", "detail")
TINY = ("--steps", "1", "--views", "2", "--size", "64x64", "--lambda-range", "1e-3", "1e-3")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Untrained networks with a step network, and a folder of graphs that holds no graph."""
    torch.manual_seed(0)
    folder, receiver = tmp_path_factory.mktemp("model"), ReceiverConfig()
    write_model(folder, serialise_receiver(Receiver(receiver)), Sender(SenderConfig(step_channels=16), receiver))
    (folder / GRAPHS_FOLDER).mkdir()
    (folder / GRAPHS_FOLDER / "predict.onnx").write_text("as it was")
    return folder


@pytest.fixture
def exported(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders whose graphs were to be exported, which takes minutes. Scenes are encoded with few steps."""
    monkeypatch.setattr("fecocodec.training.train_entropy.DEFAULT", FAST)
    monkeypatch.setattr("fecocodec.training.train_steps.DEFAULT", replace(DEFAULT, num_steps=1, extra_step_below=()))
    folders: list[Path] = []
    monkeypatch.setattr(
        "fecocodec.training.graphs.export.export_receiver", lambda folder, on_progress: folders.append(folder)
    )
    return folders


def test_entropy_writes_a_model_with_another_prior(
    fecosplat: CommandLine, model: Path, tmp_path: Path, exported: list[Path]
) -> None:
    result = fecosplat("train", "entropy", model, tmp_path / "out", *TINY, "--scenes", "1")
    assert (result.code, result.out) == (0, "") and "bpp1" in result.err
    before, after = (load_codec(folder, "cpu") for folder in (model, tmp_path / "out"))
    assert f"model id {after.model_id.hex()}" in result.err and after.model_id != before.model_id
    learned = changed(after.receiver, copied(before.receiver))
    assert learned and all(name.startswith("prior.") for name in learned)
    assert exported == [tmp_path / "out"]
    assert f"{tmp_path / 'out'}: the weights are written; exporting their graphs takes about three" in result.err


def test_steps_writes_a_sender_for_the_same_receiver(
    fecosplat: CommandLine, model: Path, tmp_path: Path, exported: list[Path]
) -> None:
    out = tmp_path / "out"
    options = ("--targets", "1", "--perceptual-weight", "0.1", "--sharp", "between")
    result = fecosplat("train", "steps", model, out, *TINY, *options)
    assert (result.code, result.out) == (0, "") and "log_bits2" in result.err
    assert (out / RECEIVER_FILE).read_bytes() == (model / RECEIVER_FILE).read_bytes()
    assert (out / GRAPHS_FOLDER / "predict.onnx").read_text() == "as it was" and exported == []
    before, after = (load_codec(folder, "cpu").sender for folder in (model, out))
    own, sharp, mean = before.steps.state_dict(), after.sharp_steps.state_dict(), after.steps.state_dict()
    assert any(not torch.equal(sharp[name], value) for name, value in own.items())
    for name, value in own.items():
        torch.testing.assert_close(mean[name], (value + sharp[name]) / 2, atol=1e-3, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_detail_fits_a_layer_to_pairs(
    fecosplat: CommandLine, model: Path, photographs: Path, tmp_path: Path, exported: list[Path]
) -> None:
    index = tmp_path / "pairs.json"
    index.write_text(json.dumps({photographs.name: {"context": [0, 1], "target": [2]}}))
    out, options = tmp_path / "out", ("--photographs", photographs.parent, "--index", index, "--components", "4")
    result = fecosplat("train", "detail", model, out, *options)
    assert result.code == 0, result.err
    assert load_codec(out, "cpu").receiver.config.detail_planes == 4 and exported == [out]


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_has_examples_and_is_named_by_train(fecosplat: CommandLine, verb: str) -> None:
    assert f"\n  {verb} " in fecosplat("train", "--help").out
    result = fecosplat("train", verb, "--help")
    assert result.code == 0 and result.out.count(f"train {verb} ") >= 3


@pytest.mark.parametrize(("arguments", "sentence"), [
    (("entropy", "nowhere", "out"), "nowhere: there is no such folder; name the folder of a model."),
    (("entropy", "{model}", "{model}"), "{model}: this folder holds a model already; choose another output path, "),
    (("steps", "{model}", "{model}/sender.safetensors"), "this is not a folder; choose another output path."),
    (("steps", "{model}", "out", "--size", "3x3"), "A training image side of 3 pixels cannot be used"),
    (("steps", "{model}", "out", "--photograph-share", "2"), "The share of photographs is (2.0, 2.0); give two"),
    (("entropy", "{model}", "out", "--textures", "nowhere"), "nowhere: there is no such file or folder; check"),
    (("detail", "{model}", "out", "--photographs", "{model}", "--index", "no"), "no: there is no such file or"),
    (
        ("detail", "{model}", "out", "--photographs", "{model}", "--index", "{index}"),
        "{index}: no entry has two context views; give an index of pairs.",
    ),
])  # fmt: skip
def test_what_cannot_be_trained_is_one_sentence(
    fecosplat: CommandLine,
    model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    index = tmp_path / "index.json"
    index.write_text(json.dumps({"scene": {"context": [0, 1, 2], "target": [3]}}))
    names = {"model": model, "index": index}
    result = fecosplat("train", *(argument.format(**names) for argument in arguments))
    assert (result.code, result.out) == (1, "")
    assert sentence.format(**names) in result.err and result.err.count("\n") == 1
    assert not (tmp_path / "out").exists() and {path.name for path in model.iterdir()} == {
        GRAPHS_FOLDER, RECEIVER_FILE, SENDER_FILE,
    }  # fmt: skip


def test_verbs_have_tables_of_their_own_in_a_file_of_defaults(fecosplat: CommandLine, tmp_path: Path) -> None:
    defaults = tmp_path / "defaults.toml"
    defaults.write_text('[train]\nsize = "3x3"\n[train.steps]\nsize = "5x5"\n')
    in_file = ("--config-file", defaults)
    assert "side of 3 pixels" in fecosplat("train", tmp_path / "run", *in_file).err
    assert "side of 5 pixels" in fecosplat("train", "steps", tmp_path, tmp_path / "out", *in_file).err
    defaults.write_text("[train.detail]\nsize = 3\n")
    assert "there is no option 'size'" in fecosplat("train", "detail", tmp_path, tmp_path / "out", *in_file).err
