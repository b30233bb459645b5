"""Where `decode` writes, and that no text of a stranger's file reaches what it writes."""

import json
from pathlib import Path

import pytest

from fecocodec.container import with_metadata
from fecocodec.splat_files import html_page
from fecocodec.splat_files.gaussian_arrays import OutputScene
from tests.splat_files.test_output_formats import some_cameras, some_gaussians


@pytest.mark.usefixtures("networks")
def test_a_file_is_decoded_beside_it_by_default(fecosplat, wall: bytes, tmp_path: Path) -> None:
    (tmp_path / "my wall.fcs").write_bytes(wall)
    result = fecosplat("decode", tmp_path / "my wall.fcs")
    assert (result.code, (tmp_path / "my wall.ply").read_bytes()[:4]) == (0, b"ply\n")
    assert result.err.startswith(f"{tmp_path / 'my wall.ply'}: ")
    assert "Give -o" in fecosplat("decode", "-").err


@pytest.mark.usefixtures("networks")
def test_title_and_author_of_a_stranger_reach_no_output(
    fecosplat, wall: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of Gaussians and pages are the same with and without metadata."""
    monkeypatch.setattr("fecocodec.splat_files.html_page.scene_page", lambda: b"/*SCENE*/ /*GAUSSIANS*/")
    evil = "</script><script>alert(1)</script>\x1b]0;owned\x07\x00"
    (tmp_path / "named").mkdir()
    (tmp_path / "named" / "wall.fcs").write_bytes(with_metadata(wall, {"title": evil, "author": evil}))
    (tmp_path / "wall.fcs").write_bytes(wall)
    for name in ("wall.glb", "wall.html", "wall.ply"):
        for folder in (tmp_path, tmp_path / "named"):
            result = fecosplat("decode", folder / "wall.fcs", "-o", folder / name)
            assert result.code == 0 and "alert" not in result.err and "\x1b" not in result.err
        assert (tmp_path / "named" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_the_name_of_a_file_cannot_end_a_script_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html_page, "scene_page", lambda: b"/*SCENE*/ /*GAUSSIANS*/")
    name = "</script><script>alert(1)\x1b/*GAUSSIANS*/<!--"
    page = html_page.file_bytes(OutputScene(some_gaussians(10), some_cameras(), name, "scene.html"))
    assert b"<" not in page and b"\x1b" not in page
    assert json.loads(page.rpartition(b" ")[0])["name"] == name
