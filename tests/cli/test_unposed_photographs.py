"""`encode` of photographs without cameras, `decode` to other formats, and the preview."""

import json
import shutil
from pathlib import Path

import pytest

from fecocodec.container import inspect
from fecocodec.formats.image_headers import read_image_size
from fecocodec.formats.transforms_json import read_transforms_json

EXAMPLE = Path(__file__).parents[2] / "examples" / "motorcycle"
FAST = ("--size", "96x64", "--stages", "1", "--effort", "fast")


@pytest.fixture
def unposed(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLE / "images", tmp_path / "photos"))


def test_photographs_without_cameras_are_encoded_previewed_and_decoded(fecosplat, unposed, tmp_path) -> None:
    pytest.importorskip("pycolmap")
    stream, cameras = tmp_path / "scene.fcs", tmp_path / "estimated.json"
    text = ("--title", "Motorcycle", "--author", "A. B.", "--licence", "CC0", "--date", "2014-01-02")
    result = fecosplat("encode", unposed, "-o", stream, *FAST, "--save-cameras", cameras, *text)
    assert result.code == 0, result.err
    assert "cameras estimated for 2 of 2 photographs" in result.err
    summary = inspect(stream.read_bytes())
    assert summary.header.num_views == 2
    assert summary.metadata == {"title": "Motorcycle", "author": "A. B.", "licence": "CC0", "date": "2014-01-02"}
    assert {photograph.path.resolve().parent for photograph in read_transforms_json(cameras).photographs} == {
        unposed.resolve()
    }

    assert fecosplat("render", stream, "-o", tmp_path / "preview.webp").code == 0
    assert read_image_size(tmp_path / "preview.webp") == (64, 96)

    for name in ("scene.compressed.ply", "scene.spz", "scene.sog", "scene.glb"):
        coded = tmp_path / f"{name}.json"
        result = fecosplat("decode", stream, "-o", tmp_path / name, "--frame", "first-camera", "--save-cameras", coded)
        assert result.code == 0, result.err
        first = json.loads(coded.read_text())["frames"][0]["transform_matrix"]
        assert first[0] == pytest.approx([1, 0, 0, 0], abs=1e-6)
        assert (tmp_path / name).stat().st_size > 1000


def test_save_cameras_is_for_photographs_without_cameras(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("encode", EXAMPLE, "-o", tmp_path / "a.fcs", "--save-cameras", tmp_path / "cameras.json")
    assert result.code == 2
    assert "this folder has cameras" in result.err
    assert list(tmp_path.iterdir()) == []


def test_save_cameras_for_an_empty_folder(fecosplat, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    result = fecosplat("encode", tmp_path / "empty", "-o", tmp_path / "a.fcs", "--save-cameras", tmp_path / "c.json")
    assert result.code == 1
    assert f"{tmp_path / 'empty'}: no cameras found" in result.err


def test_frames_is_for_a_video(fecosplat, unposed: Path, tmp_path: Path) -> None:
    result = fecosplat("encode", unposed, "-o", tmp_path / "a.fcs", "--frames", "4")
    assert result.code == 2
    assert "--frames is for a video file" in result.err


def test_one_photograph_without_cameras_is_one_sentence(fecosplat, unposed: Path, tmp_path: Path) -> None:
    next(unposed.iterdir()).unlink()
    result = fecosplat("encode", unposed, "-o", tmp_path / "a.fcs")
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {unposed}: one photograph without cameras")
    assert result.err.count("\n") == 1
    assert not (tmp_path / "a.fcs").exists()


def test_a_video_that_cannot_be_read_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    pytest.importorskip("av")
    (tmp_path / "clip.mp4").write_bytes(bytes(1000))
    result = fecosplat("encode", tmp_path / "clip.mp4", "-o", tmp_path / "a.fcs")
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {tmp_path / 'clip.mp4'}: the video cannot be read")
    assert not (tmp_path / "a.fcs").exists()


def test_a_date_must_be_a_date(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("encode", EXAMPLE, "-o", tmp_path / "a.fcs", "--date", "yesterday")
    assert result.code == 2
    assert "is not a date like" in result.err
