"""What bad input gets: one sentence that names file, place, cause and remedy."""

import math
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copy
from typing import Any

import numpy as np
import pytest
from fecosplat_cli.output import in_options
from PIL import Image
from wall_scene import (
    edited,
    shots,
    write_colmap_binary,
    write_colmap_text,
    write_realestate10k,
    write_transforms,
)

from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError

NAN, INF = float("nan"), float("inf")
DIGITS = "9" * 5000
BEYOND_BOUNDS = ": this JSON has a number of thousands of digits, or is nested too deeply; export it again."


def message(folder: Path, **options) -> str:
    """The text of the error, which has to be one line that ends in a full stop."""
    with pytest.raises(InputError) as caught:
        read_views(folder, **({"near": 1.0, "far": 9.0} | options))
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


def assert_is(text: str, expected: str) -> None:
    """`expected` is the whole sentence if it ends in a full stop, else its beginning."""
    assert text == expected if expected.endswith(".") else text.startswith(expected)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_transforms(tmp_path / "scene", shots(3))


@pytest.mark.parametrize(
    ("name", "others", "expected"),
    [
        ("nowhere", (), "no such folder; check the path."),
        (
            "",
            ("images/a.exr",),
            "no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera file.",
        ),
        (
            "",
            ("notes.txt", "images/note.txt"),
            "no photographs and no camera file found; give a folder that holds two or more photographs.",
        ),
        (
            "",
            ("b/transforms.json", "a/transforms.json"),
            "no photographs found, but 2 folders with cameras; give one of them, as {folder}/a.",
        ),
        (
            "left.JPG",
            ("left.JPG",),
            "a photograph, not a camera file; give a folder of two or more photographs, or a camera file.",
        ),
        (
            "left.txt",
            ("left.txt",),
            "not a camera file, nor a video by its name; give the folder that holds images and cameras.",
        ),
        ("a.gif", ("a.gif",), "a picture of a kind that is not read; convert them to JPEG, PNG or WebP"),
        ("a.CR2", ("a.CR2",), "a picture of a kind that is not read; develop RAW photographs to JPEG"),
    ],
)
def test_a_path_without_cameras(name: str, others: tuple[str, ...], expected: str, tmp_path: Path):
    for file in others:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text("{}")
    assert_is(message(tmp_path / name), f"{tmp_path / name}: {expected.format(folder=tmp_path)}")


def test_no_frames(scene):
    with edited(scene) as cameras:
        cameras["frames"] = []
    sentence = f'{scene}/transforms.json: no frames; add a list "frames" with one camera per image.'
    assert message(scene) == in_options(sentence) == sentence


def test_shapes_that_differ_too_much(tmp_path):
    landscape = shots(3, width=144, height=80)
    portrait = shots(4, width=80, height=144)[3]
    folder = write_transforms(tmp_path / "scene", [*landscape, portrait])
    assert message(folder) == (
        f"{folder}/images/003.png: 80x144 pixels, while the other images are 144x80; choose images of one shape by "
        "`views`, or say with `size` what all are cropped and resized to."
    )
    assert read_views(folder, size=(64, 64), near=1.0, far=9.0).image_size == (64, 64)


def test_camera_of_another_shape_than_the_image(scene):
    with Image.open(scene / "images" / "001.png") as image:
        image.transpose(Image.Transpose.ROTATE_90).save(scene / "images" / "001.png")
    assert message(scene) == (
        f"{scene}/transforms.json, frame 1 (images/001.png): the image is 80x96 pixels but its camera is for 96x80; "
        "turn the pixels by 90 degrees (an EXIF orientation is not applied), or swap the camera's sides."
    )


PANORAMAS = (
    "panoramas (EQUIRECTANGULAR) are not read; cut them into perspective images, as `ns-process-data` of nerfstudio "
    "does for its camera type equirectangular."
)
KNOWN_MODELS = (
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE, "
    "RADIAL_FISHEYE, SIMPLE_FISHEYE, FISHEYE"
)


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"frames": {"0": {}}}, ': no list "frames", but an object of this name; add'),
        ({"near": "text"}, ", near: a number expected"),
        ({"near": {}}, ", near: a number expected"),
        ({"near": [1.0]}, ", near: a number expected"),
        ({"camera_model": "EQUIRECTANGULAR"}, f", frame 0 (images/000.png): {PANORAMAS}"),
        ({"camera_model": "equirectangular"}, f", frame 0 (images/000.png): {PANORAMAS}"),
        ({"equirectangular": True}, f", frame 0 (images/000.png): {PANORAMAS}"),
        ({"latlong": True}, f", frame 0 (images/000.png): {PANORAMAS}"),
        (
            {"camera_model": "WIDE"},
            f", frame 0 (images/000.png): camera model WIDE is not known; use one of {KNOWN_MODELS}.",
        ),
        (
            {"camera_model": "FISHEYE624"},
            ", frame 0 (images/000.png): camera model FISHEYE624 is not supported; undistort the images first.",
        ),
        (
            {"ftheta_p0": 0.1},
            ", frame 0 (images/000.png): camera model FTHETA is not supported; undistort the images first.",
        ),
        (
            {"camera_model": "THIN_PRISM_FISHEYE"},
            ", frame 0 (images/000.png): camera model THIN_PRISM_FISHEYE is not supported; undistort with "
            "`colmap image_undistorter` first.",
        ),
    ],
)
def test_a_value_of_transforms_json(settings: dict[str, Any], cause: str, scene: Path):
    with edited(scene) as cameras:
        cameras |= settings
    assert_is(message(scene, near=None), f"{scene}/transforms.json{cause}")


def pose(change: Callable[[np.ndarray], object]) -> Callable[[dict[str, Any]], None]:
    """Change the pose of a frame."""

    def apply(frame: dict[str, Any]) -> None:
        matrix = np.array(frame["transform_matrix"])
        change(matrix)
        frame["transform_matrix"] = matrix.tolist()

    return apply


NOT_FINITE = ": a camera value is NaN or infinite; correct it or take this view out of the file."


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (
            pose(lambda matrix: np.negative(matrix[:, 0], out=matrix[:, 0])),
            ": the pose is mirrored (determinant -1); export right-handed camera axes.",
        ),
        (
            pose(lambda matrix: matrix[:3, :2].fill(0.5)),
            ": the pose is singular (its axes span no volume); export the cameras again.",
        ),
        (
            pose(lambda matrix: np.multiply(matrix, [2, 2, 2, 1], out=matrix)),
            ": the pose is no rotation (scale 2, axes off by",
        ),
        (
            pose(lambda matrix: np.add(matrix[:3, 0], 0.05 * matrix[:3, 1], out=matrix[:3, 0])),
            ": the pose is no rotation (scale 1, axes off by 0.0",
        ),
        (pose(lambda matrix: matrix[:3, :3].fill(1e308)), ": the axes of the pose are far from unit length"),
        (pose(lambda matrix: matrix[:3, :3].fill(1e200)), ": the axes of the pose are far from unit length"),
        (lambda frame: frame["transform_matrix"][2].__setitem__(3, NAN), f", transform_matrix{NOT_FINITE}"),
        (lambda frame: frame["transform_matrix"][2].__setitem__(3, INF), f", transform_matrix{NOT_FINITE}"),
        (lambda frame: frame["transform_matrix"][2].__setitem__(3, None), f", transform_matrix{NOT_FINITE}"),
        (lambda frame: frame.update(fl_x=NAN), f", fl_x{NOT_FINITE}"),
        (lambda frame: frame.update(transform_matrix="text"), ", transform_matrix: 4x4 numbers expected"),
        (lambda frame: frame.update(transform_matrix=[[1, 2], [3, 4]]), ", transform_matrix: 4x4 numbers expected"),
        (lambda frame: frame.update(transform_matrix=[[1], [2, 3]]), ", transform_matrix: 4x4 numbers expected"),
        (lambda frame: frame.update(transform_matrix={}), ", transform_matrix: 4x4 numbers expected"),
        (
            lambda frame: [frame.pop(key) for key in ("fl_x", "fl_y")],
            ": no positive focal length; give fl_x in pixels or camera_angle_x in radians.",
        ),
        (lambda frame: frame.update(k1=-3.0), ": its lens distortion has no inverse inside the image"),
    ],
)
def test_a_value_of_one_frame(change: Callable[[dict[str, Any]], object], cause: str, scene: Path):
    with edited(scene) as cameras:
        change(cameras["frames"][1])
    assert_is(message(scene, views=(1,)), f"{scene}/transforms.json, frame 1 (images/001.png){cause}")


def test_an_image_without_a_camera_is_told(scene):
    assert read_views(scene, near=1.0, far=9.0).notes == ()
    for name in ("b.png", "a.png", "note.txt", "000_depth_0001.png", "000.normal.png"):  # the last two: maps of 000.png
        copy(scene / "images" / "000.png", scene / "images" / name)
    told = "a.png, b.png have no camera in transforms.json and are not used; add one for each, or choose by `views`."
    assert read_views(scene, near=1.0, far=9.0).notes == (told,)
    assert read_views(scene, views=(0, 1), near=1.0, far=9.0).notes == ()


def test_near_beyond_far(scene):
    rest = "near 9 and far 2 are no range of depths; 0 < near < far is needed, set them with `near` and `far`."
    assert message(scene, near=9.0, far=2.0) == rest
    with edited(scene) as cameras:
        cameras["far"] = 2.0
    assert message(scene, near=9.0, far=None) == f"{scene}/transforms.json: {rest}"
    with edited(scene) as cameras:
        cameras |= {"near": 3.0, "far": 3.0}
    assert "near 3 and far 3 are no range of depths" in message(scene, near=None, far=None)


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ({"near": 0.0, "far": 5.0}, "near 0 and far 5 are no range of depths"),
        ({"near": -1.0, "far": 5.0}, "near -1 and far 5 are no range of depths"),
        ({"near": NAN, "far": 5.0}, "near nan and far 5 are no range of depths"),
        ({"near": 1.0, "far": INF}, "near 1 and far inf are no range of depths"),
        ({"size": (2000, 256)}, "size 256x2000: each side must have 64 to 1024 pixels; choose another `size`."),
        ({"views": ("-1",)}, "{scene}: no view is called -1 (the first is 000.png); give indices or names"),
        ({"views": ("\0",)}, "{scene}: no view is called"),
        (
            {"views": (DIGITS,)},
            f"{{scene}}: no view is called {DIGITS[:80]} (the first is 000.png); give indices or names, with commas "
            "between them, in `views`.",
        ),
    ],
)
def test_options_that_no_scene_has(options: dict[str, Any], cause: str, scene: Path):
    assert_is(message(scene, **options), cause.format(scene=scene))


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b'{\n "w": 96,\n "frames": [\n}', ", line 4, column 1: broken JSON (Expecting value); export it again."),
        (b"[]", ""),
        (b"\xff\xfe\x00", ""),
        (b"[" * 100_000, BEYOND_BOUNDS),
        (f'{{"w": {DIGITS}, "frames": []}}'.encode(), BEYOND_BOUNDS),
    ],
    ids=["broken", "list", "no UTF-8", "nested", "digits"],
)
def test_json_of_another_kind(content, cause, scene):
    (scene / "transforms.json").write_bytes(content)
    assert_is(message(scene), f"{scene}/transforms.json{cause}")


def test_cameras_too_far_from_the_origin(scene):
    with edited(scene) as cameras:
        for frame in cameras["frames"]:
            pose(lambda matrix: np.add(matrix[:3, 3], 5e6, out=matrix[:3, 3]))(frame)
    assert "too far for float32; move the origin of the scene near the cameras." in message(scene)


@pytest.mark.parametrize("table", ["cameras.bin", "images.bin", "points3D.bin"])
def test_cut_colmap_table(table, tmp_path):
    folder = write_colmap_binary(tmp_path / "scene", shots(2))
    path = folder / "sparse" / "0" / table
    whole = path.read_bytes()
    for length in range(0, len(whole), max(1, len(whole) // 50)):
        path.write_bytes(whole[:length])
        assert re.fullmatch(
            re.escape(str(path)) + r", offset \d+: the file is cut short; export the COLMAP model again\.",
            message(folder),
        )


@pytest.mark.parametrize(
    ("table", "change", "cause"),
    [
        (
            "cameras.txt",
            lambda text: text.replace("OPENCV", "THIN_PRISM_FISHEYE"),
            ", image 000.png: camera model THIN_PRISM_FISHEYE is not supported; undistort with `colmap "
            "image_undistorter` first.",
        ),
        ("cameras.txt", lambda text: "1 OPENCV wide 80 1 2 3 4\n" + text, "/cameras.txt, line 1: no "),
        ("images.txt", lambda text: "1 1 0 0\n" + text, "/images.txt, line 1: no "),
        ("points3D.txt", lambda text: "7 1.0 2.0\n" + text, "/points3D.txt, line 1: no "),
        (
            "images.txt",
            lambda text: "# empty\n",
            ": the COLMAP model has no registered images; reconstruct the scene again.",
        ),
        (
            "cameras.txt",
            lambda text: "# empty\n",
            ", image 000.png: its camera 1 is not in the model; export the model again.",
        ),
        *(
            (
                "images.txt",
                lambda text, number=number: text.replace("1.0 2.0 7 ", f"1.0 2.0 {number} "),
                "/images.txt, line 2: no image `ID QW QX",
            )
            for number in (2**63, 2**64 - 1, DIGITS)  # ids of points have 63 bits
        ),
    ],
)
def test_a_table_of_colmap(table: str, change: Callable[[str], str], cause: str, tmp_path: Path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    path = folder / "sparse" / "0" / table
    path.write_text(change(path.read_text()))
    assert_is(message(folder), f"{folder}/sparse/0{cause}")


@pytest.mark.parametrize(
    ("column", "value", "cause"),
    [
        (3, "nan", "a camera value is NaN or infinite"),
        (1, "-0.5", "the focal length is not positive"),
        (5, "0.1", "columns 6 and 7 are not 0 0"),
        (slice(1, 5), "220 220 48 40", "fx, fy, cx, cy are fractions of the image's width and height here, and 220 "),
        (8, "text", "18 numbers expected"),
        (slice(4, None), "", "4 columns found, 19 expected; export the cameras again."),
        (slice(7, None), " ".join(12 * ["1e+308"]), "the pose is singular"),
        (slice(7, None), " ".join(12 * ["1e+200"]), "the pose is singular"),
    ],
)
def test_broken_line_in_realestate10k(column, value, cause, tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(2))
    lines = (folder / "clip.txt").read_text().splitlines()
    words = lines[2].split()
    words[column] = value.split() if isinstance(column, slice) else value
    (folder / "clip.txt").write_text("\n".join([*lines[:2], " ".join(words)]))
    assert_is(message(folder, views=(1,)), f"{folder}/clip.txt, line 3: {cause}")


@pytest.mark.parametrize("name", ["/", "", ".", "..", "a\0b", "a" * 300, "\ud800"])
def test_names_that_no_image_has(name, scene):
    with edited(scene) as cameras:
        cameras["frames"][1]["file_path"] = name
    assert "frame 1" in message(scene, views=(1,))
    assert choose_photographs(scene, views=(0,)).names == ("000.png",)


@pytest.mark.parametrize("focal", [1e308, 1e9, 1e-9])
def test_focal_lengths_out_of_range(focal, scene):
    with edited(scene) as cameras:
        cameras["frames"][1]["fl_x"] = focal
    expected = r"frame 1 \(images/001\.png\): the focal length is .* image sides, but 0\.0156 to 256 are possible"
    assert re.search(expected, message(scene, views=(1,)))
    chosen = choose_photographs(scene)
    assert "001.png" not in chosen.names and "passed over (images/001.png): the focal length is" in chosen.notes[0]


@pytest.mark.parametrize("centre", [(4000, 3000), (47, -500), (0.5, 0.5)])
@pytest.mark.parametrize("write", [write_transforms, write_colmap_text])
def test_principal_points_that_no_image_has(write, centre, tmp_path):
    taken = shots(3)
    wrong = replace(taken[1], cx=centre[0], cy=centre[1])
    scene = write(tmp_path / "scene", [taken[0], replace(wrong, name="none.png"), taken[2]])
    cause = (
        f"the principal point ({centre[0]}, {centre[1]}) cannot be that of an image of 96x80 with a focal length of "
        "100; give all in one unit, and cx before cy."
    )
    assert cause in message(scene, views=("none.png",))
    chosen = choose_photographs(scene)
    assert len(chosen.names) == 2
    assert chosen.notes[0].startswith("1 of 3 cameras of ") and chosen.notes[0].endswith(f"none.png): {cause}")
    scene = write(tmp_path / "all", [replace(wrong, name=shot.name) for shot in taken])
    assert message(scene).endswith(f"000.png): {cause}" if write is write_transforms else f"000.png: {cause}")


def test_coordinates_of_a_principal_point_that_are_swapped(tmp_path):
    taken = [replace(shot, width=144, cx=71.0) for shot in shots(3)]
    assert choose_photographs(write_transforms(tmp_path / "right", taken)).notes == ()
    taken[1] = replace(taken[1], cx=41.5, cy=71.0)
    (note,) = choose_photographs(write_transforms(tmp_path / "wrong", taken)).notes
    assert "(images/001.png): the principal point (41.5, 71) cannot be that of an image of 144x80 with" in note


def test_a_photograph_cut_from_the_border_of_another_may_have_its_principal_point_outside(tmp_path):
    assert len(choose_photographs(write_transforms(tmp_path, shots(2, cx=150.0))).names) == 2


@pytest.mark.parametrize(
    ("name", "views", "cause"),
    [
        ("images/001.png", (1,), "a pipe or a device cannot be read here; give a regular file."),
        (
            "pipe",
            None,
            "not a camera file, nor a video by its name; give the folder that holds images and cameras.",
        ),
    ],
)
def test_a_pipe_is_neither_an_image_nor_a_folder_without_cameras(name, views, cause, scene):
    (scene / name).unlink(missing_ok=True)
    os.mkfifo(scene / name)
    assert message(scene if views else scene / name, views=views) == f"{scene / name}: {cause}"


@pytest.mark.parametrize("with_angle", [False, True])
def test_lenses_of_images_four_times_as_large_without_their_size(with_angle, scene):
    """The field of view tells the size, if there is one."""
    expected = read_views(scene, near=1.0, far=9.0).cameras.intrinsics
    with edited(scene) as cameras:
        for frame in cameras["frames"]:
            width = frame.pop("w")
            del frame["h"]
            if with_angle:
                frame["camera_angle_x"] = 2 * math.atan(width / 2 / frame["fl_x"])
            for key in ("fl_x", "fl_y", "cx", "cy"):
                frame[key] *= 4
    if with_angle:
        np.testing.assert_allclose(read_views(scene, near=1.0, far=9.0).cameras.intrinsics, expected, atol=1e-5)
        return
    assert message(scene) == (
        f"{scene}/transforms.json, frame 0 (images/000.png): fl_x, cx and cy are in pixels of an image of about "
        "376x332, but the image is 96x80; add w and h, the image size that they are for."
    )


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "loop"])
def test_a_camera_file_of_another_kind_is_not_taken_for_a_missing_one(kind, scene):
    """Otherwise the cameras of the photographs would be estimated."""
    path = scene / "transforms.json"
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero" if kind == "device" else path.name)
    assert message(scene).startswith(f"{path}: ")
