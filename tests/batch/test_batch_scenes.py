"""Scenes of folders and manifests, and what is refused.

What of the work of `batch encode` changes files, and what is refused before any of it.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from fecocodec.batch.decode_scene import DecodeScene
from fecocodec.batch.encode_scene import EncodeScene, passed_over
from fecocodec.batch.scenes import BatchScene, coded_scenes, scene_folders, shard_of
from fecocodec.codec.options import EncodingOptions
from fecocodec.decoding import Decoded
from fecocodec.errors import InputError
from fecocodec.geometry.gaussian_arrays import SceneCameras
from tests.splat_files.test_output_formats import some_gaussians
from tests.vectors.tiny_model import VECTORS


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("b", "a", ".hidden", "out"):
        (tmp_path / name).mkdir()
    (tmp_path / "notes.txt").write_text("not a scene")
    return tmp_path


def test_subfolders_are_scenes_and_files_beside_them_are_named(root: Path) -> None:
    assert scene_folders(root, output=root / "out") == (BatchScene("a", root / "a"), BatchScene("b", root / "b"))
    assert passed_over(root) == ()
    for name in ("a.zip", "clip.MOV", "b.jpg", ".c.jpg"):
        (root / name).touch()
    assert passed_over(root) == ("a.zip", "b.jpg", "clip.MOV")
    assert passed_over(root / "notes.txt") == ()


def test_manifests_name_paths_relative_to_themselves(root: Path) -> None:
    manifest = root / "manifest.txt"
    manifest.write_text("# comment\n\na\nother name\tb/../b\n")
    assert scene_folders(manifest) == (BatchScene("a", root / "a"), BatchScene("other name", root / "b"))
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
    manifest.write_text("missing.fcs\n")
    with pytest.raises(InputError, match=f"line 1: there is no file {root}/missing.fcs; correct the path."):
        coded_scenes(manifest)


def test_folders_without_scenes_are_refused(root: Path, tmp_path: Path) -> None:
    (root / "transforms.json").write_text("{}")
    with pytest.raises(InputError, match="this folder is a scene; give the folder that contains the scene folders"):
        scene_folders(root)
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
    with pytest.raises(InputError, match="needs the steps"):
        EncodeScene(EncodingOptions(effort="fast", sharpness=0.5))


UPSIDE_DOWN = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(("suffix", "has_note"), [(".ply", False), (".glb", True)])
def test_a_scene_that_does_not_show_which_way_is_up_is_noted_where_it_should_stand(suffix: str, has_note: bool) -> None:
    extrinsics = np.stack((np.eye(4), UPSIDE_DOWN)).astype(np.float32)
    intrinsics = np.tile(np.diag([1.0, 1.0, 1.0]).astype(np.float32), (2, 1, 1))
    decoded = Decoded(some_gaussians(10), SceneCameras(extrinsics, intrinsics, 1.0, 10.0), (64, 64), 2, None)
    result = DecodeScene(suffix, lambda data: decoded).run(Path(VECTORS / "valid/two-views.fcs"), "a")
    assert result.details.get("notes") == (
        ["the cameras do not agree on which way is up, so the up direction of the first one is taken."]
        if has_note
        else None
    )
