"""Scenes of folders and manifests, and what is refused.

What of the work of `batch encode` changes files, and what is refused before any of it.
"""

import os
from pathlib import Path

import pytest

from fecocodec.batch.encode_scene import EncodeScene, passed_over
from fecocodec.batch.scenes import BatchScene, coded_scenes, scene_folders, shard_of
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import InputError


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("b", "a", ".hidden", "out"):
        (tmp_path / name).mkdir()
    (tmp_path / "notes.txt").write_text("not a scene")
    return tmp_path


def test_subfolders_are_scenes_except_the_output(root: Path) -> None:
    assert scene_folders(root, output=root / "out") == (BatchScene("a", root / "a"), BatchScene("b", root / "b"))


def test_files_beside_scene_folders_are_named(root: Path) -> None:
    assert passed_over(root) == ()
    for name in ("a.zip", "clip.MOV", "b.jpg", ".c.jpg"):
        (root / name).touch()
    assert passed_over(root) == ("a.zip", "b.jpg", "clip.MOV")
    assert passed_over(root / "notes.txt") == ()


def test_a_manifest_names_paths_relative_to_itself(root: Path) -> None:
    manifest = root / "manifest.txt"
    manifest.write_text("# comment\n\na\nother name\tb/../b\n")
    assert scene_folders(manifest) == (BatchScene("a", root / "a"), BatchScene("other name", root / "b"))


def test_coded_scenes_are_fcs_files(root: Path) -> None:
    (root / "one.fcs").write_bytes(b"1")
    (root / "manifest.txt").write_text(f"{root / 'one.fcs'}\ntwo\tone.fcs\n")
    assert coded_scenes(root) == (BatchScene("one", root / "one.fcs"),)
    assert [scene.name for scene in coded_scenes(root / "manifest.txt")] == ["one", "two"]


def test_shards_partition_the_scenes() -> None:
    scenes = [BatchScene(str(number), Path("x")) for number in range(7)]
    shards = [shard_of(scenes, number, 3) for number in (1, 2, 3)]
    assert sorted((scene for shard in shards for scene in shard), key=lambda scene: scene.name) == scenes


@pytest.mark.parametrize("number", [0, 4])
def test_a_shard_that_does_not_exist_is_refused(number: int) -> None:
    with pytest.raises(InputError, match=f"shard {number}/3: there is no such shard; give a number from 1 to 3."):
        shard_of([], number, 3)


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ("a\n\nmissing\n", "{manifest}, line 3: there is no folder {root}/missing; correct the path."),
        ("notes.txt\n", "{manifest}, line 1: there is no folder {root}/notes.txt; correct the path."),
        ("a\nA\tb\n", "{manifest}: two scenes are called A ({root}/a and {root}/b); name them in a manifest."),
        ("../x\ta\n", "{manifest}: '../x' cannot be the name of a scene; use that of a file."),
        ("\n", "{manifest}: there are no scenes in it; give a folder of scenes or a manifest."),
    ],
)
def test_a_wrong_manifest_is_one_sentence(root: Path, lines: str, sentence: str) -> None:
    manifest = root / "manifest.txt"
    manifest.write_text(lines)
    with pytest.raises(InputError) as caught:
        scene_folders(manifest)
    assert str(caught.value) == sentence.format(manifest=manifest, root=root)


def test_a_folder_that_is_a_scene_is_refused(root: Path) -> None:
    (root / "transforms.json").write_text("{}")
    with pytest.raises(InputError, match="this folder is a scene; give the folder that contains the scene folders"):
        scene_folders(root)


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing: cannot be read \(No such file or directory\); give a folder"):
        scene_folders(tmp_path / "missing")


@pytest.mark.parametrize("scenes", [scene_folders, coded_scenes])
def test_a_pipe_is_refused_without_waiting(tmp_path: Path, scenes) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError) as caught:
        scenes(tmp_path / "pipe")
    assert (
        str(caught.value) == f"{tmp_path / 'pipe'}: this is a pipe or a device; give a folder of scenes or a manifest."
    )


def test_sharpness_is_an_option_of_a_file_only_where_it_is_given() -> None:
    plain, sharp = EncodeScene(), EncodeScene(EncodingOptions(sharpness=0.5))
    assert "sharpness" not in plain.options()  # files that were encoded before there was one stay valid
    assert sharp.options() == plain.options() | {"sharpness": 0.5}


def test_a_sharpness_without_steps_is_refused() -> None:
    with pytest.raises(InputError, match="needs the steps"):
        EncodeScene(EncodingOptions(effort="fast", sharpness=0.5))
