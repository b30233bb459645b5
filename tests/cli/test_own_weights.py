"""`--model FOLDER`: weights that do not ship."""

from pathlib import Path

import pytest

import fecocodec
from tests.example_scenes import MODEL


@pytest.fixture(scope="module")
def model(random_weights: Path) -> Path:
    return random_weights / MODEL


@pytest.fixture(scope="module")
def wall(photographs: Path, model: Path) -> bytes:
    """A stream of one stage: with untrained networks, the second does harm, and `encode` leaves it out."""
    views = fecocodec.read_views(photographs, views=(0, 1))
    return fecocodec.encode(views, effort="fast", model=model, num_stages=1)


def test_files_of_own_weights_go_there_and_back(fecosplat, photographs, model, wall, tmp_path, monkeypatch) -> None:
    file, splats, images = tmp_path / "wall.fcs", tmp_path / "wall.ply", tmp_path / "images"
    options = ("--views", "0,1", "--guides", "none", "--effort", "fast", "--model", ".")
    monkeypatch.chdir(model)  # a relative folder
    assert fecosplat("encode", photographs, "-o", file, *options).code == 0
    assert file.read_bytes() == wall
    assert fecosplat("decode", file, "-o", splats, "--model", model).code == 0
    expected = fecocodec.decode(wall, model=model).gaussians
    assert fecocodec.read_ply(splats).count == expected.count > 0
    assert fecosplat("render", file, "-o", images, "--model", model).code == 0
    assert sorted(path.suffix for path in images.iterdir()) == [".exr", ".exr", ".png", ".png"]
    partly = fecosplat("decode", file, "-o", tmp_path / "partial.ply", "--partial", "--model", model)
    assert partly.code == 0


@pytest.mark.parametrize("goal", [(), ("--target-kib", "8")])
def test_a_folder_without_weights(fecosplat, photographs: Path, tmp_path: Path, goal: tuple[str, ...]) -> None:
    output, empty = tmp_path / "wall.fcs", tmp_path / "empty"
    empty.mkdir()
    result = fecosplat("encode", photographs, "-o", output, "--model", empty, *goal)
    assert result.code == 1
    assert f"{empty / 'receiver.safetensors'}: the weights cannot be read (No such file or directory)" in result.err
    assert not output.exists()
