"""Evaluation indices as pixelSplat, DepthSplat and our own data write them."""

import json
from pathlib import Path

import pytest

from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.errors import InputError


def test_public_indices_are_read(tmp_path: Path) -> None:
    path = tmp_path / "index.json"
    entries = {
        "5aca87f95a9412c6": {"context": [58, 133], "target": [84, 102, 129]},
        "e74ceac9043aa1b8": None,
        "fox/wide1": {"context": [1, 8], "target": [6], "overlap": 0.6},
        "fox/guided2": {"context": [1, 8], "target": [6], "guide": [5, 2]},
    }
    path.write_text(json.dumps(entries))
    assert read_index(path) == (
        IndexEntry("5aca87f95a9412c6", "5aca87f95a9412c6", (58, 133), (84, 102, 129)),
        IndexEntry("fox/wide1", "fox", (1, 8), (6,)),
        IndexEntry("fox/guided2", "fox", (1, 8), (6,), (5, 2)),
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{]", "line 1, column 2: broken JSON"),
        ("[1]", "not an evaluation index"),
        ('{"a": {"context": [1, 2]}}', "entry a: `context` and `target` must be lists of frame numbers"),
        ('{"a": {"context": [1, -2], "target": [1]}}', "entry a"),
        ('{"a": {"context": [1, 2.5], "target": [1]}}', "entry a"),
        ('{"a": {"context": [], "target": [1]}}', "entry a"),
        ('{"a": {"context": [1], "target": [2], "guide": 3}}', "entry a: `guide` must be a list of frame numbers"),
        ('{"a": {"context": [1], "target": [2], "guide": [3, 2]}}', "entry a: `guide` .* in neither other list"),
        ('{"a": [1, 2]}', "entry a"),
        ('{"a": {"context": [1], "target": [2], "guides": [3]}}', "entry a: has `guides`; write `guide`"),
        ('{"a": {"context": [1], "target": [2], "Guided": [3]}}', "has `Guided`; write `guide`"),
        ('{"a/b": null, "a/b": {"context": [1], "target": [2]}}', "the name a/b is there twice; remove one"),
        ('{"a": {"context": [1, 2], "target": [3, 4, 3]}}', "entry a: `target` has frame 3 twice; name it once"),
        ('{"a": {"context": [1], "target": [2], "guide": [3, 3]}}', "entry a: `guide` has frame 3 twice"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "index.json"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_index(path)
