"""Photographs, cameras and options that `encode` refuses: one sentence that names the file, and nothing left behind."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image
from refusals import assert_refused

from fecocodec.poses.unposed_photographs import find_photographs, unused_images
from tests.wall_scene import edited


@pytest.fixture
def scene(photographs: Path, tmp_path: Path) -> Path:
    """Photographs that a test may damage."""
    return Path(shutil.copytree(photographs, tmp_path / "photographs"))


@pytest.mark.usefixtures("networks")
def test_a_view_without_an_image_is_refused_if_it_is_named_and_else_passed_over(fecosplat, scene, output) -> None:
    (scene / "view_1.png").unlink()
    with edited(scene) as cameras:
        cameras["frames"][1]["file_path"] = "view\n1.png"
    encode = ("encode", scene, "-o", output / "a.fcs", "--effort", "fast", "--stages", "1", "--json")
    absent = f"there is no image {scene}/view\\n1.png; put it there or leave this view out by --views."
    place = f"{scene}/transforms.json, frame 1 (view\\n1.png)"
    assert_refused(fecosplat(*encode, "--views", "0,1,2,3"), output, f"{place}: {absent}")
    missing = (
        "1 of 4 images that transforms.json names is missing and is passed over (view\\n1.png); put it there to use it"
    )
    strict = fecosplat(*encode, "--strict")
    assert_refused(strict, output, f"{scene}: {missing} (--strict makes this warning an error).")
    result = fecosplat(*encode)
    assert (result.code, result.err.splitlines()[0]) == (0, f"warning: {missing}.")
    fields = json.loads(result.out)
    assert [view["name"] for view in fields["context_views"]] == ["view_0.png", "view_2.png", "view_3.png"]
    assert fields["warnings"][0] == f"{missing}.".replace("\\n", "\n")


@pytest.mark.parametrize(
    ("files", "given", "sentence"),
    [
        (
            ("a.CR2", "images/b.dng"),
            "",
            "photographs of this kind cannot be read (.cr2, .dng); develop RAW photographs to JPEG, TIFF or PNG.",
        ),
        (
            ("rgb/a.jpg", "scan/left/a.jpg"),
            "",
            "no photographs found here, but in 2 folders below; give one of them, as {folder}/rgb, or put all "
            "photographs of the scene into one folder.",
        ),
        (
            ("rgb/a.jpg", "scan/left/a.jpg"),
            "scan",
            "no photographs found here, but in {folder}/scan/left; give that folder.",
        ),
    ],
)
def test_photographs_that_are_not_used_are_named(fecosplat, tmp_path: Path, output: Path, files, given, sentence):
    folder = tmp_path / "photographs"
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(b"II*")
    result = fecosplat("encode", folder / given, "-o", output / "a.fcs")
    assert_refused(result, output, f"{folder / given}: {sentence.format(folder=folder)}")


def test_hidden_files_are_no_photographs(tmp_path: Path) -> None:
    for name in ("a.jpg", "._a.jpg", "b.PNG"):
        (tmp_path / name).touch()
    assert [path.name for path in find_photographs(tmp_path)] == ["a.jpg", "b.PNG"]


def test_photographs_are_those_of_the_folder_with_most(tmp_path: Path) -> None:
    for name in ("preview.jpg", "input/a.jpg", "input/b.jpg", "input/b_depth.png", "input/b.jpg.mask.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [path.name for path in find_photographs(tmp_path)] == ["a.jpg", "b.jpg"]
    assert {path.name for path in unused_images(tmp_path)} == {"preview.jpg", "b_depth.png", "b.jpg.mask.png"}
    for name in ("rgb_01.png", "depth_01.png", "02_color.png", "02_depth.png", "03.png", "normal03.png", "depth_9.png"):
        (tmp_path / "input" / name).touch()
    shown = {"a.jpg", "b.jpg", "rgb_01.png", "02_color.png", "03.png", "depth_9.png"}
    assert {path.name for path in find_photographs(tmp_path)} == shown


def test_large_photographs_are_said_to_be_scaled_before_they_are_read(fecosplat, scene: Path, tmp_path: Path) -> None:
    for image in scene.glob("*.png"):
        with Image.open(image) as photograph:
            photograph.resize((1152, 96)).save(image)
    with edited(scene) as cameras:
        cameras |= {"w": 1152, "h": 96, "fl_x": 1152.0, "fl_y": 1152.0}
    (scene / "view_2.png").write_bytes((scene / "view_2.png").read_bytes()[:2000])
    output = tmp_path / "wall.fcs"
    result = fecosplat("encode", scene, "-o", output, "--views", "0,1,2,3")
    assert result.code == 1 and not output.exists()
    remark, error = result.err.splitlines()
    assert remark == "note: photographs of 1152x96 are coded at 1024x85; no side may exceed 1024 pixels."
    assert "view_2.png" in error
    assert "note:" not in fecosplat("encode", scene, "-o", output, "--views", "0,1,2,3", "--size", "96x64").err
