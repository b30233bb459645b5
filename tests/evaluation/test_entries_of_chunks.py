"""Public evaluation indices over chunks: which frames are read, in which order, at which size, with which bounds."""

import json
from pathlib import Path

import pytest

from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.errors import InputError
from fecocodec.evaluation.novel_views import open_scenes, without_guides
from tests.chunk_files import record, write_chunks
from tests.example_scenes import write_scene
from tests.wall_scene import shots

CAPTURE = "1f0e06e4388dd600"  # DL3DV's records name no video
EIGHT = [0, 1, 3, 4, 6, 7, 9, 10]


def write_index(path: Path, entries: dict) -> Path:
    path.write_text(json.dumps(entries))
    return path


def test_entries_are_read_at_the_size_and_bounds_of_their_protocol(tmp_path: Path) -> None:
    chunks = [[record("video", shots(4))], [record("capture", shots(11), url=CAPTURE)]]
    read = open_scenes(write_chunks(tmp_path / "test", chunks))
    entries = {
        "video": {"context": [0, 3], "target": [2, 1], "overlap": 0.7},
        "left_out": None,
        "capture": {"context": EIGHT, "target": [5]},
    }
    pair, several = read_index(write_index(tmp_path / "index.json", entries))
    views = read(pair)
    assert views.image_size == (256, 256) and [name.split(":")[0] for name in views.names] == ["0", "3", "2", "1"]
    assert (float(views.cameras.near), float(views.cameras.far)) == (0.5, 100.0)
    views = read(several)
    assert views.image_size == (256, 448) and [int(name.split(":")[0]) for name in views.names] == [*EIGHT, 5]
    assert (float(views.cameras.near), float(views.cameras.far)) == (0.5, 200.0)


def test_an_entry_beyond_the_scene_names_chunk_and_frame(tmp_path: Path) -> None:
    root = write_chunks(tmp_path / "test", [[record("video", shots(2))]])
    (entry,) = read_index(write_index(tmp_path / "index.json", {"video": {"context": [0, 1], "target": [7]}}))
    with pytest.raises(InputError, match=r"000000\.torch, scene video: there is no frame \[7\]"):
        open_scenes(root)(entry)


def test_an_entry_with_guides_may_have_more_frames_than_a_file_holds(tmp_path: Path) -> None:
    write_scene(tmp_path / "scene", num_views=19)
    entry = IndexEntry("scene", "scene", tuple(range(0, 16, 2)), (1, 3), (*range(5, 16, 2), 16, 17, 18))
    views, guides = without_guides(open_scenes(tmp_path, (64, 64))(entry), entry)
    assert [int(name.split(".")[0]) for name in views.names] == [*entry.context, *entry.target]
    assert guides is not None and [int(name.split(".")[0]) for name in guides.names] == [*entry.guide]
    assert guides.cameras.num_views == 9
