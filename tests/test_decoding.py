"""One function decodes: onnxruntime where the model has all its graphs, torch where it has not or is asked for."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import fecocodec
from fecocodec import decoding
from fecocodec.errors import InputError, ModelError
from fecocodec.model_files import GRAPHS_FOLDER, NETWORK_GRAPHS, RULE_GRAPHS, SHIPPED
from fecocodec.receiver import decode as torch_decode
from fecocodec.runtime import decode as runtime_decode
from tests.vectors.tiny_graphs import FOLDER as TINY_GRAPHS
from tests.vectors.tiny_model import VECTORS

SCENE = VECTORS / "valid" / "scene-compact-6.fcs"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A copy of the model of the scene."""
    folder = tmp_path / "model"
    shutil.copytree(SHIPPED / "compact-6", folder)
    return folder


@pytest.fixture
def receivers(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the receivers that decode, one per call."""
    used: list[str] = []
    for name, module in (("torch", torch_decode), ("onnxruntime", runtime_decode)):

        def counted(*args: object, of: str = name, call: object = module.decode, **options: object) -> object:
            used.append(of)
            assert callable(call)
            return call(*args, **options)

        monkeypatch.setattr(module, "decode", counted)
    return used


def test_a_model_with_all_graphs_needs_no_torch(model: Path, receivers: list[str]) -> None:
    decoded = fecocodec.decode(SCENE.read_bytes(), model=model, stages=1)
    assert receivers == ["onnxruntime"]
    assert all(isinstance(field, np.ndarray) for field in decoded.gaussians.fields())


@pytest.mark.parametrize("missing", ["hyper", "update", "step_3", "behind"])
def test_an_interrupted_export_is_decoded_with_torch(model: Path, receivers: list[str], missing: str) -> None:
    (model / GRAPHS_FOLDER / f"{missing}.onnx").unlink()
    decoded = fecocodec.decode(SCENE.read_bytes(), model=model, stages=1)
    assert receivers == ["torch"]
    expected = fecocodec.decode(SCENE.read_bytes(), stages=1)
    assert decoded.gaussians.count == pytest.approx(expected.gaussians.count, abs=3)
    assert (decoded.image_size, decoded.stages, decoded.damage) == (expected.image_size, 1, None)
    for mine, theirs in zip(decoded.cameras.fields(), expected.cameras.fields(), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_graphs_of_earlier_weights_are_not_run(model: Path, receivers: list[str]) -> None:
    """An export over the graphs of other weights was interrupted."""
    shutil.copy(TINY_GRAPHS / "hyper.onnx", model / GRAPHS_FOLDER)
    fecocodec.decode(SCENE.read_bytes(), model=model, stages=1)
    assert receivers == ["torch"]


def test_every_graph_counts(model: Path) -> None:
    model_id = fecocodec.container.read_header(SCENE.read_bytes()).header.model_id
    for name in NETWORK_GRAPHS + RULE_GRAPHS:
        assert decoding.has_graphs(model, model_id)
        graph = (model / GRAPHS_FOLDER / f"{name}.onnx").rename(model / "away")
        assert not decoding.has_graphs(model, model_id), name
        graph.rename(model / GRAPHS_FOLDER / f"{name}.onnx")


def test_every_command_decodes_an_interrupted_export(model: Path, tmp_path: Path) -> None:
    """In a process of their own, which has not loaded torch."""
    (model / GRAPHS_FOLDER / "update.onnx").unlink()
    coded = tmp_path / "coded"
    coded.mkdir()
    shutil.copy(SCENE, coded / "a.fcs")
    commands = (
        ["decode", coded / "a.fcs", "-o", tmp_path / "a.ply", "--stages", "1"],
        ["batch", "decode", coded, "-o", tmp_path / "many", "--stages", "1", "--shard", "1/1"],
        ["render", coded / "a.fcs", "-o", tmp_path / "a.png", "--stages", "1"],
    )
    arguments = [[*map(str, command), "--model", str(model)] for command in commands]
    program = f"from fecosplat_cli.main import run; raise SystemExit(any([run(command) for command in {arguments}]))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "many" / "a.ply").read_bytes() == (tmp_path / "a.ply").read_bytes()
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_without_torch_the_missing_graph_is_named(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "find_spec", lambda _name: None)
    (model / GRAPHS_FOLDER / "update.onnx").unlink()
    with pytest.raises(ModelError, match=rf"update.onnx: the graph is missing, .*training.graphs {model}"):
        fecocodec.decode(SCENE.read_bytes(), model=model)


def test_another_device_asks_for_torch() -> None:
    with pytest.raises(InputError, match="device cuda:99 was asked for, but torch sees"):
        fecocodec.decode(SCENE.read_bytes(), device="cuda:99")


def test_what_is_decoded_can_be_rendered_and_written(tmp_path: Path) -> None:
    decoded = fecocodec.decode(SCENE.read_bytes(), stages=1)
    image = fecocodec.render(decoded.gaussians, decoded.cameras, decoded.image_size).color
    tensors = fecocodec.Gaussians.of(decoded.gaussians), fecocodec.Cameras.of(decoded.cameras)
    assert image.std() > 0.05
    assert torch.equal(fecocodec.render(*tensors, decoded.image_size).color, image)
    fecocodec.write_ply(tmp_path / "scene.ply", decoded.gaussians)
    assert fecocodec.read_ply(tmp_path / "scene.ply").count == decoded.gaussians.count
