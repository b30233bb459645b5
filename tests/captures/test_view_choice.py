"""Choose views by index or by name."""

from pathlib import Path

import numpy as np
import pytest

from fecocodec.camera_files.posed_photographs import PosedPhotograph
from fecocodec.captures.view_choice import choose_views
from fecocodec.errors import InputError
from fecocodec.photographs.lens import Lens

FOLDER = Path("scene")


def photographs(*names: str) -> list[PosedPhotograph]:
    return [
        PosedPhotograph(FOLDER / name, name, np.eye(4), lambda width, height: Lens(width, height, 1.0, 1.0, 0.0, 0.0))
        for name in names
    ]


def chosen(available: list[PosedPhotograph], *views: int | str) -> list[str]:
    return [photograph.path.name for photograph in choose_views(available, views, FOLDER)]


def test_by_index_and_by_name():
    available = photographs("left/a.png", "left/b.png", "left/7.png")
    assert chosen(available, 2, 0) == ["7.png", "a.png"]
    assert chosen(available, "b", "a.png", "left/7.png") == ["b.png", "a.png", "7.png"]
    assert chosen(available, "1") == ["b.png"]
    assert chosen(available, "7") == ["7.png"]


@pytest.mark.parametrize(
    ("views", "text"),
    [
        ((3,), "scene: there is no view 3; give indices from 0 to 2 in `views`."),
        (("3",), "scene: there is no view 3; give indices from 0 to 2 in `views`."),
        ((-1,), "scene: there is no view -1; give indices from 0 to 2 in `views`."),
        (
            ("c",),
            "scene: no view is called c (the first is a.png); give indices or names, with commas between them, in "
            "`views`.",
        ),
        (("b",), "scene: 2 views are called b; give more of its path, or an index, in `views`."),
        ((0, "a"), "scene: view a.png is chosen twice; name each view once in `views`."),
        ((), "scene: 0 views chosen, but 1 to 16 can be used; change `views`."),
        (tuple(range(17)), "scene: 17 views chosen, but 1 to 16 can be used; change `views`."),
    ],
)
def test_refusals(views, text):
    with pytest.raises(InputError) as caught:
        chosen(photographs("left/a.png", "left/b.png", "right/b.png"), *views)
    assert str(caught.value) == text
