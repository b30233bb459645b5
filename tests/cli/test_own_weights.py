"""`--model FOLDER`: weights that do not ship."""

from pathlib import Path

import pytest

import fecocodec
from fecocodec.container import inspect
from tests.example_scenes import MODEL


@pytest.fixture(scope="module")
def model(random_weights: Path) -> Path:
    return random_weights / MODEL


@pytest.fixture(scope="module")
def wall(photographs: Path, model: Path) -> bytes:
    """A stream of one stage: with untrained networks, the second does harm, and `encode` leaves it out."""
    views = fecocodec.read_views(photographs, views=(0, 1))
    return fecocodec.encode(views, effort="fast", model=model, num_stages=1)


def test_files_of_own_weights_go_there_and_back(
    fecosplat, photographs: Path, model: Path, wall: bytes, tmp_path: Path
) -> None:
    file, splats, images = tmp_path / "wall.fcs", tmp_path / "wall.ply", tmp_path / "images"
    assert (
        fecosplat(
            "encode",
            photographs,
            "-o",
            file,
            "--views",
            "0,1",
            "--guides",
            "none",
            "--effort",
            "fast",
            "--model",
            model,
        ).code
        == 0
    )
    assert file.read_bytes() == wall
    assert fecosplat("decode", file, "-o", splats, "--model", model).code == 0
    expected = fecocodec.decode(wall, model=model).gaussians
    assert fecocodec.read_ply(splats).count == expected.count > 0
    assert fecosplat("render", file, "-o", images, "--model", model).code == 0
    assert sorted(path.suffix for path in images.iterdir()) == [".exr", ".exr", ".png", ".png"]
    partly = fecosplat("decode", file, "-o", tmp_path / "partial.ply", "--partial", "--model", model)
    assert partly.code == 0


def test_a_relative_folder(
    fecosplat, photographs: Path, model: Path, wall: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(model)
    assert (
        fecosplat(
            "encode",
            photographs,
            "-o",
            tmp_path / "wall.fcs",
            "--views",
            "0,1",
            "--guides",
            "none",
            "--effort",
            "fast",
            "--model",
            ".",
        ).code
        == 0
    )
    assert (tmp_path / "wall.fcs").read_bytes() == wall


def test_weights_of_another_model(fecosplat, coded_scene: Path, model: Path, tmp_path: Path) -> None:
    result = fecosplat("decode", coded_scene, "-o", tmp_path / "wall.ply", "--model", model)
    model_id = inspect(coded_scene.read_bytes()).header.model_id.hex()
    assert result.code == 1
    assert f"needs the receiver weights with model id {model_id}, but {model} has {MODEL};" in result.err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(fecosplat, coded_scene: Path, tmp_path: Path) -> None:
    missing = tmp_path / "missing"
    result = fecosplat("decode", coded_scene, "-o", tmp_path / "wall.ply", "--model", missing)
    assert result.code == 1
    assert f"{missing}: there is no such folder; name the folder of a model." in result.err


@pytest.mark.parametrize("goal", [(), ("--target-kib", "8")])
def test_a_folder_without_weights(fecosplat, photographs: Path, tmp_path: Path, goal: tuple[str, ...]) -> None:
    output, empty = tmp_path / "wall.fcs", tmp_path / "empty"
    empty.mkdir()
    result = fecosplat("encode", photographs, "-o", output, "--model", empty, *goal)
    assert result.code == 1
    assert f"{empty / 'receiver.safetensors'}: the weights cannot be read (No such file or directory)" in result.err
    assert not output.exists()
