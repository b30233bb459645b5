"""Photographs, cameras and options that `encode` refuses: one sentence that names the file, and nothing left behind."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from refusals import assert_refused

from fecocodec.checkpoint import RECEIVER_FILE
from fecocodec.poses.unposed_photographs import find_photographs, unused_images
from tests.example_scenes import MODEL
from tests.wall_scene import edited

Damage = Callable[[Path], None]


@pytest.fixture
def scene(photographs: Path, tmp_path: Path) -> Path:
    """Photographs that a test may damage."""
    return Path(shutil.copytree(photographs, tmp_path / "photographs"))


def editing(change: Callable[[dict[str, Any]], object]) -> Damage:
    def edit(folder: Path) -> None:
        with edited(folder) as cameras:
            change(cameras)

    return edit


def turn_an_image(folder: Path) -> None:
    editing(lambda cameras: [cameras.pop(side) for side in ("w", "h")])(folder)
    with Image.open(folder / "view_3.png") as image:
        image.transpose(Image.Transpose.ROTATE_90).save(folder / "view_3.png")


NO_RANGE = "near {} and far 2 are no range of depths; 0 < near < far is needed, set them with --near and --far."
FRAME = "{folder}/transforms.json, frame 1 (view_1.png)"
BAD_PHOTOGRAPHS: dict[str, tuple[Damage, str]] = {
    "image of another shape": (
        turn_an_image,
        "{folder}/view_3.png: 64x96 pixels, while the other images are 96x64; choose images of one shape by --views, "
        "or say with --size what all are cropped and resized to.",
    ),
    "near equals far": (
        editing(lambda cameras: cameras.update(near=2.0, far=2.0)),
        "{folder}/transforms.json: " + NO_RANGE.format(2),
    ),
    "lens that a stream cannot hold": (
        editing(lambda cameras: cameras.update(fl_x=96e6)),
        "{folder}/transforms.json, frame 0 (view_0.png): the focal length is 1e+06 and the principal point 0.5 image "
        "sides, but 0.0156 to 256 are possible; correct the camera.",
    ),
}
BAD_VIEWS: dict[str, tuple[Damage, str]] = {  # errors only if the view is named
    "cameras without images": (
        lambda folder: [(folder / f"view_{view}.png").unlink() for view in (1, 2, 3)],
        FRAME + ": there is no image {folder}/view_1.png, and of 4 images 3 are missing in all; put them there or "
        "choose others by --views.",
    ),
    "name that no file can have": (
        editing(lambda cameras: cameras["frames"][0].update(file_path="a" * 300 + ".png")),
        "{folder}/transforms.json, frame 0 (aaa...",
    ),
    "name with a line break": (
        editing(lambda cameras: cameras["frames"][0].update(file_path="view\n0.png")),
        "{folder}/transforms.json, frame 0 (view\\n0.png): there is no image {folder}/view\\n0.png; put it there or "
        "leave this view out by --views.",
    ),
}


@pytest.mark.usefixtures("networks")
@pytest.mark.parametrize(("damage", "sentence"), BAD_PHOTOGRAPHS.values(), ids=BAD_PHOTOGRAPHS)
def test_bad_photographs(fecosplat, scene: Path, output: Path, damage: Damage, sentence: str) -> None:
    damage(scene)
    result = fecosplat("encode", scene, "-o", output / "a.fcs")
    assert_refused(result, output, sentence.replace("{folder}", str(scene)))


@pytest.mark.usefixtures("networks")
@pytest.mark.parametrize(("damage", "sentence"), BAD_VIEWS.values(), ids=BAD_VIEWS)
def test_bad_views(fecosplat, scene: Path, output: Path, damage: Damage, sentence: str) -> None:
    damage(scene)
    named = fecosplat("encode", scene, "-o", output / "a.fcs", "--views", "0,1,2,3")
    assert_refused(named, output, sentence.replace("{folder}", str(scene)))
    strict = fecosplat("encode", scene, "-o", output / "a.fcs", "--strict")
    assert strict.code == 1 and " passed over (" in strict.err and strict.err.count("\n") == 1
    assert strict.err.endswith(" (--strict makes this warning an error).\n")
    assert list(output.iterdir()) == []


@pytest.mark.usefixtures("networks")
def test_views_that_cannot_be_used_are_passed_over(fecosplat, scene: Path, output: Path) -> None:
    (scene / "view_1.png").unlink()
    result = fecosplat("encode", scene, "-o", output / "a.fcs", "--effort", "fast", "--stages", "1", "--json")
    assert result.code == 0
    warning = (
        "1 of 4 images that transforms.json names is missing and is passed over (view_1.png); put it there to use it."
    )
    assert result.err.splitlines()[0] == f"warning: {warning}"
    fields = json.loads(result.out)
    assert [view["name"] for view in fields["context_views"]] == ["view_0.png", "view_2.png", "view_3.png"]
    assert fields["warnings"][0] == warning


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--near", "5", "--far", "2"), NO_RANGE.format(5)),
        (("--size", "96x32"), "size 96x32: each side must have 64 to 1024 pixels; choose another --size."),
        (
            ("--views", "9"),
            "{folder}: 9 views asked for, but the folder has 4; choose 1 to 4, or name photographs in --views, by file "
            "names or by numbers with a comma (`0,5` or `7,`).",
        ),
    ],
)
def test_bad_options(fecosplat, photographs: Path, output: Path, options: tuple[str, ...], sentence: str) -> None:
    result = fecosplat("encode", photographs, "-o", output / "a.fcs", *options)
    assert_refused(result, output, sentence.replace("{folder}", str(photographs)))


def test_damaged_weights(fecosplat, photographs: Path, tmp_path: Path, output: Path) -> None:
    weights = tmp_path / "weights" / MODEL / RECEIVER_FILE
    weights.parent.mkdir(parents=True)
    weights.write_text("no weights")
    result = fecosplat("encode", photographs, "-o", output / "a.fcs", "--model", weights.parent)
    assert_refused(result, output, f"{weights}: not a weights file of this codec, or damaged; reinstall the package.")


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
    editing(lambda cameras: cameras.update(w=1152, h=96, fl_x=1152.0, fl_y=1152.0))(scene)
    (scene / "view_2.png").write_bytes((scene / "view_2.png").read_bytes()[:2000])
    output = tmp_path / "wall.fcs"
    result = fecosplat("encode", scene, "-o", output, "--views", "0,1,2,3")
    assert result.code == 1 and not output.exists()
    remark, error = result.err.splitlines()
    assert remark == "note: photographs of 1152x96 are coded at 1024x85; no side may exceed 1024 pixels."
    assert "view_2.png" in error
    assert "note:" not in fecosplat("encode", scene, "-o", output, "--views", "0,1,2,3", "--size", "96x64").err
