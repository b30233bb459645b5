"""What bad input gets: one sentence that names file, place, cause and remedy."""

import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fecosplat_cli.output import in_options
from PIL import Image
from wall_scene import (
    shots,
    write_colmap_binary,
    write_colmap_text,
    write_photographs,
    write_realestate10k,
    write_transforms,
)

from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError


def message(folder: Path, **options) -> str:
    """The text of the error, which has to be one line that ends in a full stop."""
    with pytest.raises(InputError) as caught:
        read_views(folder, **({"near": 1.0, "far": 9.0} | options))
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


@pytest.fixture
def scene(tmp_path) -> Path:
    return write_transforms(tmp_path / "scene", shots(3))


def edit(scene: Path, change) -> None:
    cameras = json.loads((scene / "transforms.json").read_text())
    change(cameras)
    (scene / "transforms.json").write_text(json.dumps(cameras))


def set_matrix(scene: Path, index: int, change) -> None:
    def apply(cameras):
        matrix = np.array(cameras["frames"][index]["transform_matrix"])
        change(matrix)
        cameras["frames"][index]["transform_matrix"] = matrix.tolist()

    edit(scene, apply)


def test_missing_folder(tmp_path):
    folder = tmp_path / "nowhere"
    assert message(folder) == f"{folder}: no such folder; give the folder that holds images and cameras."


def test_no_cameras(tmp_path):
    write_photographs(tmp_path, shots(1))
    assert message(tmp_path) == (
        f"{tmp_path}: no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera "
        "file."
    )


def test_no_photographs(tmp_path):
    (tmp_path / "notes.txt").write_text("no scene")
    (tmp_path / "images").mkdir()
    assert message(tmp_path) == (
        f"{tmp_path}: no photographs and no camera file found; give a folder that holds two or more photographs."
    )
    (tmp_path / "images" / "a.exr").write_bytes(b"not looked at")
    assert "no cameras found" in message(tmp_path)


def test_a_folder_of_scenes_names_one(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "transforms.json").write_text("{}")
    assert message(tmp_path) == (
        f"{tmp_path}: no photographs found, but 2 folders with cameras; give one of them, as {tmp_path / 'a'}."
    )


def test_a_photograph_is_not_a_camera_file(tmp_path: Path) -> None:
    photograph = tmp_path / "left.JPG"
    photograph.write_bytes(b"not looked at")
    assert message(photograph) == (
        f"{photograph}: a photograph, not a camera file; give a folder of two or more photographs, or a camera file."
    )


def test_a_file_that_is_no_camera_file(tmp_path: Path) -> None:
    file = tmp_path / "left.txt"
    file.write_bytes(b"hello")
    assert message(file) == (
        f"{file}: not a camera file, nor a video by its name; give the folder that holds images and cameras."
    )
    for name, remedy in (("a.gif", "convert them to JPEG, PNG or WebP"), ("a.CR2", "develop RAW photographs to JPEG")):
        (tmp_path / name).write_bytes(b"")
        sentence = message(tmp_path / name)
        assert sentence.startswith(f"{tmp_path / name}: a picture of a kind that is not read; {remedy}")


def test_no_frames(scene):
    edit(scene, lambda cameras: cameras.update(frames=[]))
    sentence = f'{scene}/transforms.json: no frames; add a list "frames" with one camera per image.'
    assert message(scene) == in_options(sentence) == sentence
    edit(scene, lambda cameras: cameras.update(frames={"0": {}}))
    assert message(scene).startswith(f'{scene}/transforms.json: no list "frames", but an object of this name; add')


@pytest.mark.parametrize("write", [write_transforms, write_colmap_text, write_colmap_binary])
def test_camera_without_image(write, tmp_path):
    folder = write(tmp_path / "scene", shots(3))
    (folder / "images" / "001.png").unlink()
    text = message(folder, views=(1,))
    assert "001.png" in text.split(": there is no image ")[0]
    assert text.endswith(
        f": there is no image {folder}/images/001.png; put it there or leave this view out by `views`."
    )


def test_camera_without_image_in_realestate10k(tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(3))
    (folder / "001.png").unlink()
    assert message(folder, views=(1,)) == (
        f"{folder}/clip.txt, line 3: there is no image {folder}/001; put it there or leave this view out by `views`."
    )


def test_truncated_image(scene):
    image = scene / "images" / "002.png"
    image.write_bytes(image.read_bytes()[:3000])
    assert re.fullmatch(
        re.escape(f"{image}: the image is damaged, cut short or of a kind that is not read (")
        + r"[^)]+\)+; store it again or remove it\.",
        message(scene),
    )


def test_unreadable_image(scene):
    image = scene / "images" / "000.png"
    image.write_bytes(b"this is no image")
    damaged = "the image is damaged, cut short or of a kind that is not read"
    assert message(scene) == f"{image}: {damaged}; store it again or remove it."


def test_shapes_that_differ_too_much(tmp_path):
    landscape = shots(3, width=144, height=80)
    portrait = shots(4, width=80, height=144)[3]
    folder = write_transforms(tmp_path / "scene", [*landscape, portrait])
    assert message(folder) == (
        f"{folder}/images/003.png: 80x144 pixels, while the other images are 144x80; choose images of one shape by "
        "`views`, or say with `size` what all are cropped and resized to."
    )
    assert read_views(folder, size=(64, 64), near=1.0, far=9.0).image_size == (64, 64)


def test_too_small(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2, width=96, height=50))
    assert message(folder) == (
        f"{folder}/images/000.png: 96x50 pixels, but each side must have 64 to 1024; use larger images or give `size`."
    )


def test_size_out_of_range(scene):
    assert message(scene, size=(2000, 256)) == (
        "size 256x2000: each side must have 64 to 1024 pixels; choose another `size`."
    )


def test_camera_of_another_shape_than_the_image(scene):
    with Image.open(scene / "images" / "001.png") as image:
        image.transpose(Image.Transpose.ROTATE_90).save(scene / "images" / "001.png")
    assert message(scene) == (
        f"{scene}/transforms.json, frame 1 (images/001.png): the image is 80x96 pixels but its camera is for 96x80; "
        "turn the pixels by 90 degrees (an EXIF orientation is not applied), or swap the camera's sides."
    )


def test_mirrored_pose(scene):
    set_matrix(scene, 2, lambda matrix: np.negative(matrix[:, 0], out=matrix[:, 0]))
    assert message(scene, views=(2,)) == (
        f"{scene}/transforms.json, frame 2 (images/002.png): the pose is mirrored (determinant -1); "
        "export right-handed camera axes."
    )


def test_singular_pose(scene):
    set_matrix(scene, 0, lambda matrix: matrix[:3, :2].fill(0.5))
    assert message(scene, views=(0,)) == (
        f"{scene}/transforms.json, frame 0 (images/000.png): the pose is singular (its axes span no volume); "
        "export the cameras again."
    )


def test_scaled_pose(scene):
    set_matrix(scene, 0, lambda matrix: np.multiply(matrix, [2, 2, 2, 1], out=matrix))
    assert "frame 0 (images/000.png): the pose is no rotation (scale 2, axes off by" in message(scene, views=(0,))


def test_sheared_pose(scene):
    set_matrix(scene, 0, lambda matrix: np.add(matrix[:3, 0], 0.05 * matrix[:3, 1], out=matrix[:3, 0]))
    assert "frame 0 (images/000.png): the pose is no rotation (scale 1, axes off by 0.0" in message(scene, views=(0,))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), None])
def test_value_that_is_no_number_in_a_pose(value, scene):
    edit(scene, lambda cameras: cameras["frames"][1]["transform_matrix"][2].__setitem__(3, value))
    assert message(scene, views=(1,)) == (
        f"{scene}/transforms.json, frame 1 (images/001.png), transform_matrix: a camera value is NaN or infinite; "
        "correct it or take this view out of the file."
    )


def test_value_that_is_no_number_in_a_lens(scene):
    edit(scene, lambda cameras: cameras["frames"][1].update(fl_x=float("nan")))
    assert "frame 1 (images/001.png), fl_x: a camera value is NaN or infinite" in message(scene, views=(1,))


@pytest.mark.parametrize("matrix", ["text", [[1, 2], [3, 4]], [[1], [2, 3]], {}])
def test_pose_of_another_kind(matrix, scene):
    edit(scene, lambda cameras: cameras["frames"][1].update(transform_matrix=matrix))
    assert "frame 1 (images/001.png), transform_matrix: 4x4 numbers expected" in message(scene, views=(1,))


def test_no_pose(scene):
    edit(scene, lambda cameras: cameras["frames"][1].pop("transform_matrix"))
    assert message(scene, views=(1,)) == (
        f"{scene}/transforms.json, frame 1 (images/001.png): no `transform_matrix`; add the pose of its camera, or "
        "remove the frame."
    )


def test_one_image_in_two_frames(scene):
    edit(scene, lambda cameras: cameras["frames"][1].update(file_path=cameras["frames"][0]["file_path"]))
    assert message(scene, views=(1,)) == (
        f"{scene}/transforms.json, frame 1 (images/000.png): another frame has this image, too, and its camera is "
        "used; name the image of each with its folder, or remove one."
    )


def test_an_image_without_a_camera_is_told(scene):
    from shutil import copy

    assert read_views(scene, near=1.0, far=9.0).notes == ()
    for name in ("b.png", "a.png", "note.txt", "000_depth_0001.png", "000.normal.png"):  # the last two: maps of 000.png
        copy(scene / "images" / "000.png", scene / "images" / name)
    told = "a.png, b.png have no camera in transforms.json and are not used; add one for each, or choose by `views`."
    assert read_views(scene, near=1.0, far=9.0).notes == (told,)
    assert read_views(scene, views=(0, 1), near=1.0, far=9.0).notes == ()


def test_no_focal_length(scene):
    edit(scene, lambda cameras: [cameras["frames"][0].pop(key) for key in ("fl_x", "fl_y")])
    assert message(scene, views=(0,)) == (
        f"{scene}/transforms.json, frame 0 (images/000.png): no positive focal length; "
        "give fl_x in pixels or camera_angle_x in radians."
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
        ({"camera_model": "EQUIRECTANGULAR"}, PANORAMAS),
        ({"camera_model": "equirectangular"}, PANORAMAS),
        ({"equirectangular": True}, PANORAMAS),
        ({"latlong": True}, PANORAMAS),
        ({"camera_model": "WIDE"}, f"camera model WIDE is not known; use one of {KNOWN_MODELS}."),
        ({"camera_model": "FISHEYE624"}, "camera model FISHEYE624 is not supported; undistort the images first."),
        ({"ftheta_p0": 0.1}, "camera model FTHETA is not supported; undistort the images first."),
        (
            {"camera_model": "THIN_PRISM_FISHEYE"},
            "camera model THIN_PRISM_FISHEYE is not supported; undistort with `colmap image_undistorter` first.",
        ),
    ],
)
def test_camera_model_that_is_not_supported(settings, cause, scene):
    edit(scene, lambda cameras: cameras.update(settings))
    assert message(scene) == f"{scene}/transforms.json, frame 0 (images/000.png): {cause}"


def test_camera_model_of_colmap_that_is_not_supported(tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    table = folder / "sparse" / "0" / "cameras.txt"
    table.write_text(table.read_text().replace("OPENCV", "THIN_PRISM_FISHEYE"))
    assert message(folder) == (
        f"{folder}/sparse/0, image 000.png: camera model THIN_PRISM_FISHEYE is not supported; "
        "undistort with `colmap image_undistorter` first."
    )


def test_distortion_without_inverse(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(1))
    edit(folder, lambda cameras: cameras["frames"][0].update(k1=-3.0))
    assert "frame 0 (images/000.png): its lens distortion has no inverse inside the image" in message(folder)


def test_near_beyond_far(scene):
    rest = "near 9 and far 2 are no range of depths; 0 < near < far is needed, set them with `near` and `far`."
    assert message(scene, near=9.0, far=2.0) == rest
    edit(scene, lambda cameras: cameras.update(far=2.0))
    assert message(scene, near=9.0, far=None) == f"{scene}/transforms.json: {rest}"
    edit(scene, lambda cameras: cameras.update(near=3.0, far=3.0))
    assert "near 3 and far 3 are no range of depths" in message(scene, near=None, far=None)


@pytest.mark.parametrize(("near", "far"), [(0.0, 5.0), (-1.0, 5.0), (float("nan"), 5.0), (1.0, float("inf"))])
def test_bounds_that_are_no_depths(near, far, scene):
    assert "are no range of depths" in message(scene, near=near, far=far)


def test_broken_json(scene):
    (scene / "transforms.json").write_text('{\n "w": 96,\n "frames": [\n}')
    assert message(scene) == (
        f"{scene}/transforms.json, line 4, column 1: broken JSON (Expecting value); export it again."
    )


@pytest.mark.parametrize("content", [b"[]", b"\xff\xfe\x00", b"[" * 100_000])
def test_json_of_another_kind(content, scene):
    (scene / "transforms.json").write_bytes(content)
    assert message(scene).startswith(f"{scene}/transforms.json")


def test_cameras_too_far_from_the_origin(scene):
    for index in range(3):
        set_matrix(scene, index, lambda matrix: np.add(matrix[:3, 3], 5e6, out=matrix[:3, 3]))
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
    ("table", "line"),
    [("cameras.txt", "1 OPENCV wide 80 1 2 3 4"), ("images.txt", "1 1 0 0"), ("points3D.txt", "7 1.0 2.0")],
)
def test_broken_line_in_a_colmap_table(table, line, tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    path = folder / "sparse" / "0" / table
    path.write_text(line + "\n" + path.read_text())
    assert message(folder).startswith(f"{path}, line 1: no ")


def test_colmap_without_images(tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    (folder / "sparse" / "0" / "images.txt").write_text("# empty\n")
    assert message(folder) == (
        f"{folder}/sparse/0: the COLMAP model has no registered images; reconstruct the scene again."
    )


def test_colmap_image_without_its_camera(tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    (folder / "sparse" / "0" / "cameras.txt").write_text("# empty\n")
    assert "image 000.png: its camera 1 is not in the model; export the model again." in message(folder)


@pytest.mark.parametrize(
    ("column", "value", "cause"),
    [
        (3, "nan", "a camera value is NaN or infinite"),
        (1, "-0.5", "the focal length is not positive"),
        (5, "0.1", "columns 6 and 7 are not 0 0"),
        (8, "text", "18 numbers expected"),
    ],
)
def test_broken_line_in_realestate10k(column, value, cause, tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(2))
    lines = (folder / "clip.txt").read_text().splitlines()
    words = lines[2].split()
    words[column] = value
    (folder / "clip.txt").write_text("\n".join([*lines[:2], " ".join(words)]))
    assert message(folder, views=(1,)).startswith(f"{folder}/clip.txt, line 3: {cause}")


def test_short_line_in_realestate10k(tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(2))
    with (folder / "clip.txt").open("a") as file:
        file.write("0003 1 2 3\n")
    assert message(folder, views=(2,)) == (
        f"{folder}/clip.txt, line 4: 4 columns found, 19 expected; export the cameras again."
    )


DIGITS = "9" * 5000


@pytest.mark.parametrize("where", ["w", "fl_x", "near"])
def test_integers_of_thousands_of_digits(where, scene):
    text = (scene / "transforms.json").read_text()
    (scene / "transforms.json").write_text(f'{{"{where}": {DIGITS}, ' + text.lstrip()[1:])
    assert message(scene) == (
        f"{scene}/transforms.json: this JSON has a number of thousands of digits, or is nested too deeply; "
        "export it again."
    )


@pytest.mark.parametrize("view", [DIGITS, "-1", "\0"])
def test_views_that_no_folder_has(view, scene):
    assert "no view is called" in message(scene, views=(view,))


@pytest.mark.parametrize("name", ["/", "", ".", "..", "a\0b", "a" * 300, "\ud800"])
def test_names_that_no_image_has(name, scene):
    edit(scene, lambda cameras: cameras["frames"][1].update(file_path=name))
    assert str(scene) in message(scene, views=(1,))


@pytest.mark.parametrize("point_id", [2**63, 2**64 - 1, DIGITS])
def test_point_ids_of_colmap_beyond_63_bits(point_id, tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    images = folder / "sparse" / "0" / "images.txt"
    images.write_text(images.read_text().replace("1.0 2.0 7 ", f"1.0 2.0 {point_id} "))
    assert "sparse/0/images.txt, line 2: no image `ID QW QX" in message(folder)


@pytest.mark.parametrize("focal", [1e308, 1e9, 1e-9])
def test_focal_lengths_out_of_range(focal, scene):
    edit(scene, lambda cameras: cameras["frames"][1].update(fl_x=focal))
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


@pytest.mark.parametrize("value", [1e308, 1e200])
def test_poses_out_of_range(value, tmp_path):
    scene = write_transforms(tmp_path / "transforms", shots(2))
    set_matrix(scene, 0, lambda matrix: matrix[:3, :3].fill(value))
    assert "frame 0 (images/000.png): the axes of the pose are far from unit length" in message(scene, views=(0,))
    folder = write_realestate10k(tmp_path / "realestate", shots(2))
    lines = (folder / "clip.txt").read_text().splitlines()
    words = lines[1].split()
    (folder / "clip.txt").write_text("\n".join([lines[0], " ".join([*words[:7], *12 * [repr(value)]]), *lines[2:]]))
    assert "clip.txt, line 2: the pose is singular" in message(folder, views=(0,))


def test_an_image_that_is_a_pipe(scene):
    (scene / "images" / "001.png").unlink()
    os.mkfifo(scene / "images" / "001.png")
    assert (
        message(scene, views=(1,))
        == f"{scene}/images/001.png: a pipe or a device cannot be read here; give a regular file."
    )


def test_a_pipe_is_not_taken_for_a_folder_without_cameras(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert message(tmp_path / "pipe") == (
        f"{tmp_path / 'pipe'}: not a camera file, nor a video by its name; give the folder that holds images and "
        "cameras."
    )


def test_a_camera_file_that_is_too_long(scene):
    with (scene / "transforms.json").open("r+b") as file:
        file.truncate(513 << 20)
    assert "transforms.json: the file has 537919488 bytes, but at most 536870912 are read" in message(scene)


def test_reduced_images_whose_cameras_have_another_principal_point(scene):
    """transforms.json without w and h, made for images four times as large."""

    def enlarge(cameras):
        for values in (cameras, *cameras["frames"]):
            for key in ("w", "h"):
                values.pop(key, None)
            for key in ("fl_x", "fl_y", "cx", "cy"):
                if key in values:
                    values[key] *= 4

    edit(scene, enlarge)
    assert message(scene) == (
        f"{scene}/transforms.json, frame 0 (images/000.png): fl_x, cx and cy are in pixels of an image of about "
        "376x332, but the image is 96x80; add w and h, the image size that they are for."
    )


def test_the_size_of_a_lens_is_derived_from_its_field_of_view(scene):
    def enlarge(cameras):
        for frame in cameras["frames"]:
            width = frame.pop("w")
            del frame["h"]
            frame["camera_angle_x"] = 2 * math.atan(width / 2 / frame["fl_x"])
            for key in ("fl_x", "fl_y", "cx", "cy"):
                frame[key] *= 4

    expected = read_views(scene, near=1.0, far=9.0).cameras.intrinsics
    edit(scene, enlarge)
    np.testing.assert_allclose(read_views(scene, near=1.0, far=9.0).cameras.intrinsics, expected, atol=1e-5)


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


@pytest.mark.parametrize("value", ["text", {}, [1.0]])
def test_a_value_that_should_be_one_number(value, scene):
    edit(scene, lambda cameras: cameras.update(near=value))
    assert f"{scene}/transforms.json, near: a number expected" in message(scene, near=None)


def test_long_names_of_views_are_shortened(scene):
    assert message(scene, views=(DIGITS,)) == (
        f"{scene}: no view is called {DIGITS[:80]} (the first is 000.png); give indices or names, with commas "
        "between them, in `views`."
    )
