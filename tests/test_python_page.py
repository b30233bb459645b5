"""Snippets of docs/python.md run as printed."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from fecocodec import write_ply
from fecocodec.container import inspect
from fecocodec.evaluation.paper_tables import read_external
from tests.rendering.small_scenes import random_gaussians
from tests.wall_scene import shots, write_transforms

ROOT = Path(__file__).resolve().parent.parent
SNIPPETS = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text("utf-8"), re.DOTALL)


def test_photographs_without_cameras_become_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pycolmap")
    (snippet,) = (snippet for snippet in SNIPPETS if "posed_folder" in snippet)
    shutil.copytree(ROOT / "examples/motorcycle/images", tmp_path / "photos")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(snippet, names)
    data = names["data"]
    assert isinstance(data, bytes)
    assert inspect(data).metadata == {"title": "Garden"}
    assert len(json.loads((tmp_path / "estimated.json").read_text())["frames"]) == 2
    assert len(json.loads((tmp_path / "cameras.json").read_text())) == 2
    assert (tmp_path / "scene.spz").stat().st_size > 10_000


def test_own_gaussians_are_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (snippet,) = (snippet for snippet in SNIPPETS if "read_ply" in snippet)
    write_transforms(tmp_path / "photos", shots(4), near=1.0, far=20.0)
    gaussians = random_gaussians(50)
    write_ply(tmp_path / "own.ply", replace(gaussians, opacities=gaussians.opacities.clamp(0, 1)))
    monkeypatch.chdir(tmp_path)
    exec(snippet, {})
    (row,) = read_external(Path("others.csv"))
    assert row.system == "own" and row.kib == (tmp_path / "own.ply").stat().st_size / 1024
    assert row.psnr is not None and 0 < row.psnr < 100 and row.ssim is not None and 0 < row.ssim < 1
