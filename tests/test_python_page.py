"""The snippet of docs/python.md about photographs without cameras and output files runs as printed."""

import json
import re
import shutil
from pathlib import Path

import pytest

from fecocodec.container import inspect

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
