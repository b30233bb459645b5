"""Cameras of other programs are read, or named where they are not: none is passed over in silence."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from wall_scene import (
    shots,
    write_cameras_json,
    write_colmap_binary,
    write_colmap_text,
    write_llff,
    write_photographs,
    write_realestate10k,
    write_transforms,
)

from fecocodec.camera_files.find import has_cameras
from fecocodec.camera_files.unused_cameras import unread_cameras_notes
from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.render_cameras import read_render_cameras
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError

CENTRAL = {"cx": 48.0, "cy": 40.0, "fy": 100.0}  # what formats without principal point assume


def assert_cameras_of_shots(path: Path, count: int = 3) -> None:
    chosen = choose_photographs(path)
    assert (chosen.notes, chosen.remarks) == ((), ())
    np.testing.assert_allclose(chosen.extrinsics, [shot.camera_to_world for shot in shots(count)], atol=1e-6)
    np.testing.assert_allclose(chosen.intrinsics[0], [[100 / 96, 0, 0.5], [0, 100 / 80, 0.5], [0, 0, 1]], atol=1e-9)


@pytest.mark.parametrize("write", [write_cameras_json, write_llff])
@pytest.mark.parametrize("where", ["images", "."])
def test_cameras_beside_or_above_the_images(write: Callable[..., Path], where: str, tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(3, **CENTRAL))
    if where == ".":
        for image in [*(folder / "images").iterdir()]:
            image.rename(folder / image.name)
        (folder / "images").rmdir()
    assert has_cameras(folder)
    assert_cameras_of_shots(folder)
    assert_cameras_of_shots(next(path for path in folder.iterdir() if path.suffix in (".json", ".npy")))


def test_llff_has_bounds_and_needs_one_image_for_each_camera(tmp_path: Path) -> None:
    """Maps beside the images are left out."""
    folder = write_llff(tmp_path / "scene", shots(3, **CENTRAL), bounds=(1.5, 7.5))
    cameras = read_views(folder).cameras
    assert (cameras.near.item(), cameras.far.item()) == (1.5, 7.5)
    shutil.copy(folder / "images" / "000.png", folder / "images" / "000_depth.png")
    assert_cameras_of_shots(folder)
    (folder / "images" / "001.png").unlink()
    with pytest.raises(InputError) as refused:
        choose_photographs(folder)
    assert str(refused.value) == (
        f"{folder}/poses_bounds.npy: has cameras for 3 images, but there are 2 in {folder}/images; put exactly the "
        "images there that it was made from."
    )


def test_a_row_of_llff_that_is_not_valid_matters_only_if_it_is_named(tmp_path: Path) -> None:
    folder = write_llff(tmp_path / "scene", shots(3))
    rows = np.load(folder / "poses_bounds.npy")
    rows[1, 3] = np.nan
    np.save(folder / "poses_bounds.npy", rows)
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.png", "002.png")
    assert chosen.notes[0].startswith(
        "1 of 3 cameras of poses_bounds.npy is passed over (001.png): a camera value is NaN"
    )
    with pytest.raises(InputError, match="row 1: a camera value is NaN"):
        choose_photographs(folder, views=(1,))


@pytest.mark.parametrize(
    ("array", "cause"),
    [
        (np.zeros((3, 16)), "an array of 17 numbers for each image is expected; export it again."),
        (np.zeros((0, 17)), "no cameras; export it again."),
        (np.array([["a"] * 17]), "an array of 17 numbers for each image is expected; export it again."),
        (np.array([[{}] * 17], dtype=object), "this is no array as NumPy writes it; export it again."),
        (b"text", "this is no array as NumPy writes it; export it again."),
    ],
)
def test_files_that_are_not_llffs(array: object, cause: str, tmp_path: Path) -> None:
    folder = write_llff(tmp_path / "scene", shots(2))
    path = folder / "poses_bounds.npy"
    if isinstance(array, bytes):
        path.write_bytes(array)
    else:
        np.save(path, array)
    with pytest.raises(InputError) as refused:
        choose_photographs(folder)
    assert str(refused.value) == f"{path}: {cause}"


def test_names_of_3dgs_end_at_the_first_dot(tmp_path: Path) -> None:
    """Older versions store `os.path.basename(image_path).split(".")[0]`."""
    folder = write_cameras_json(tmp_path / "scene", shots(3, **CENTRAL))
    for image in [*(folder / "images").iterdir()]:
        image.rename(image.with_name(f"{image.stem}.frame.png"))
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.frame.png", "001.frame.png", "002.frame.png")
    assert len(chosen.remarks) == 1 and chosen.notes == ()


def test_other_files_called_cameras_json_are_named(tmp_path: Path) -> None:
    write_photographs(tmp_path, shots(2))
    for text in ('{"cameras": []}', '{"frames": [{"pose": []}]}', "[1, 2]", "broken"):
        (tmp_path / "cameras.json").write_text(text)
        assert not has_cameras(tmp_path)
        assert unread_cameras_notes(tmp_path) == [
            "cameras in cameras.json are not read, and cameras are estimated; to use them, convert them to a "
            "transforms.json or a COLMAP model."
        ]


@pytest.mark.parametrize("where", ["dense/0", "dense", "dense/3", "undistorted"])
@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_undistorted_images_of_colmap(where: str, write: Callable[..., Path], tmp_path: Path) -> None:
    """`colmap image_undistorter` writes images/ and sparse/ into the folder."""
    write(tmp_path / where, shots(3, **CENTRAL), where="sparse")
    assert_cameras_of_shots(tmp_path)
    assert_cameras_of_shots(tmp_path / where)
    assert_cameras_of_shots(tmp_path / where / "sparse")


def test_original_images_of_colmap_come_before_undistorted_ones(tmp_path: Path) -> None:
    write_colmap_text(tmp_path, shots(2))
    write_colmap_text(tmp_path / "dense" / "0", shots(3), where="sparse")
    assert choose_photographs(tmp_path).names == ("000.png", "001.png")


def write_two_models(folder: Path) -> Path:
    """COLMAP models of two and of five photographs."""
    write_colmap_binary(folder, shots(6)[:2], where="sparse/0")
    write_colmap_text(folder, shots(6)[1:], where="sparse/1")
    return folder


def test_the_largest_of_several_colmap_models(tmp_path: Path) -> None:
    folder = write_two_models(tmp_path / "scene")
    chosen = choose_photographs(folder)
    assert chosen.names == tuple(f"{number:03d}.png" for number in range(1, 6))
    assert chosen.notes == (
        "000.png has no camera in sparse/1 and is not used; add one for each, or choose by `views`.",
    )
    assert chosen.remarks == (
        "of 2 COLMAP models, sparse/1 is used, which has most images (5; sparse/0 has 2); give the folder of another "
        "one to use it.",
    )
    assert choose_photographs(folder / "sparse").names == chosen.names
    other = choose_photographs(folder / "sparse" / "0")  # what the note says
    assert (other.names, other.remarks) == (("000.png", "001.png"), ())
    rendered = read_render_cameras(folder)
    assert len(rendered.names) == 5 and rendered.notes == chosen.remarks


@pytest.mark.parametrize("table", ["images.txt", "images.bin"])
def test_a_model_that_is_cut_short_does_not_hide_another(table: str, tmp_path: Path) -> None:
    folder = write_two_models(tmp_path / "scene")
    (folder / "sparse" / "0" / "images.bin").unlink()
    (folder / "sparse" / "0" / table).write_bytes(b"\xff" * 12 if table == "images.bin" else b"")
    assert len(choose_photographs(folder).names) == 5


def test_splits_of_blender_are_named_and_can_be_given(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(4))
    scene = json.loads((folder / "transforms.json").read_text())
    for name, frames in (("train", scene["frames"][:2]), ("val", scene["frames"][2:3]), ("test", scene["frames"][3:])):
        (folder / f"transforms_{name}.json").write_text(json.dumps({"frames": frames}))
    (folder / "transforms.json").unlink()
    chosen = choose_photographs(folder)
    assert (chosen.names, chosen.notes) == (("000.png", "001.png"), ())  # the others have cameras in other splits
    assert chosen.remarks == (
        "transforms_val.json, transforms_test.json have cameras, too, which are not used; give one of them in place of "
        "the folder to use it.",
    )
    chosen = choose_photographs(folder / "transforms_test.json")
    assert (chosen.names, chosen.notes) == (("003.png",), ())
    for name in ("train", "test"):
        (folder / f"transforms_{name}.json").unlink()
    chosen = choose_photographs(folder)
    assert chosen.names == ("002.png",)
    assert chosen.notes[0].startswith("000.png, 001.png, 003.png have no camera in transforms_val.json and are not")


def test_formats_that_are_read_are_named_beside_the_one_that_is_used(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    write_colmap_text(folder, shots(2))
    write_llff(folder, shots(2))
    write_cameras_json(folder, shots(2))
    write_realestate10k(tmp_path / "other", shots(2))
    shutil.copy(tmp_path / "other" / "clip.txt", folder)
    (remark,) = choose_photographs(folder).remarks
    assert remark.startswith("sparse/0, clip.txt, cameras.json, poses_bounds.npy have cameras, too")
    for name in ("sparse/0", "clip.txt", "cameras.json", "poses_bounds.npy"):
        assert choose_photographs(folder / name).names == ("000.png", "001.png")


FOREIGN = {
    "meta_data.json": ("{}", "sdfstudio"),
    "keyframes/cameras/1.json": ("{}", "Polycam"),
    "keyframes/corrected_cameras/1.json": ("{}", "Polycam"),
    "export.xml": ('<?xml version="1.0"?><document version="1.5.0"><chunk label="a">', "Metashape"),
    "blocks.xml": ("<BlocksExchange version='3.2'>", "BlocksExchange"),
    "scan.csv": ("#name,x,y,alt,heading,pitch,roll\n", "RealityCapture"),
    "images/000.xmp": ("<x:xmpmeta><rdf:Description xcr:Version='3'>", "RealityCapture"),
    "reconstruction.json": ("[]", "OpenSfM"),
    "bundle.out": ("# Bundle file v0.3\n", "Bundler"),
    "scene.nvm": ("NVM_V3\n", "VisualSFM"),
    "sfm.json": ('{"sfm_data_version": "0.3"}', "OpenMVG"),
    "project.sfm": ("{}", "Meshroom"),
    "metadata.json": ('{"poses": []}', "ARKit, Record3D"),
    "frame_00000.json": ('{"cameraPoseARFrame": []}', "ARKit, 3D Scanner App"),
    "odometry.csv": ("timestamp, frame, x", "ARKit, Stray Scanner"),
    "lowres_wide.traj": ("1 2 3", "ARKitScenes"),
    "predictions.npz": ("", "VGGT"),
    "pred_traj.txt": ("0 1 2", "DUSt3R"),
    "groundtruth.txt": ("# timestamp tx ty tz qx qy qz qw", "TUM RGB-D"),
    "livingroom.log": ("0 0 1\n1 0 0 0.5\n0 -1.0e-3 0 0\n0 0 1 0\n0 0 0 1\n", "Redwood, Open3D"),
    "cams/00000000_cam.txt": ("extrinsic", "MVSNet"),
    "my_poses.npy": ("", ""),
    "groundtruth_trajectory.txt": ("", ""),
    "poses/000.txt": ("", ""),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_camera_files_that_are_not_read_are_named(name: str, tmp_path: Path) -> None:
    text, program = FOREIGN[name]
    posed, unposed = write_transforms(tmp_path / "posed", shots(2)), tmp_path / "unposed"
    write_photographs(unposed / "images", shots(2))
    for folder in (posed, unposed):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    shown = f"{name} ({program})" if program else name.replace("poses/000.txt", "poses")
    (remark,) = choose_photographs(posed).remarks
    assert remark == f"cameras in {shown} are not read; those of transforms.json are used."
    assert not has_cameras(unposed)
    (note,) = unread_cameras_notes(unposed)
    assert note.startswith(f"cameras in {shown} are not read, and cameras are estimated; to use them, convert them to")
    if program:
        with pytest.raises(InputError, match=f"cameras of {program} are not read; convert them to a transforms.json"):
            choose_photographs(posed / name)


def test_arrays_of_numpy_with_cameras_are_named(tmp_path: Path) -> None:
    write_photographs(tmp_path, shots(2))
    np.savez(tmp_path / "result.npz", extrinsic=np.eye(4), depth=np.zeros(3))
    np.savez(tmp_path / "depth.npz", depth=np.zeros(3))
    (note,) = unread_cameras_notes(tmp_path)
    assert note.startswith("cameras in result.npz are not read")


@pytest.mark.parametrize(
    "where",
    [
        *("Transforms.json", "transforms (1).json", "model", "colmap/text", "a/b/sparse", "SPARSE/0"),
        *("colmap/models/0", "output/colmap/sparse/0", "workspace/dense/0/sparse", "sparse/0/refined/0"),
    ],
)
def test_cameras_with_unusual_names_and_places_can_be_given(where: str, tmp_path: Path) -> None:
    if where.endswith(".json"):
        folder = write_transforms(tmp_path / "scene", shots(3, **CENTRAL))
        (folder / "transforms.json").rename(folder / where)
    else:
        write = write_colmap_binary if "0" in where else write_colmap_text
        folder = write(tmp_path / "scene", shots(3, **CENTRAL), where=where)
    assert not has_cameras(folder)
    to_use = f"to use them, give {folder / where}."
    assert unread_cameras_notes(folder) == [
        f"cameras in {where} are not looked for, and cameras are estimated; {to_use}"
    ]
    assert choose_photographs(folder / where).names == ("000.png", "001.png", "002.png")


def test_a_part_of_a_colmap_model_is_named_and_without_photographs_refused(tmp_path: Path) -> None:
    folder = write_colmap_text(tmp_path / "scene", shots(3))
    (folder / "sparse" / "0" / "images.txt").unlink()
    (note,) = unread_cameras_notes(folder)
    assert note == "sparse/0 has no images.bin or images.txt, and cameras are estimated; export it again."
    shutil.rmtree(folder / "images")
    with pytest.raises(InputError, match="no photographs"):
        choose_photographs(folder)


def test_many_files_are_counted_and_those_without_cameras_are_not_named(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    frames = [folder / f"frame_{number}.json" for number in range(5)]
    for frame in frames:
        frame.write_text('{"cameraPoseARFrame": []}')
    (remark,) = choose_photographs(folder).remarks
    assert remark.startswith("cameras in frame_0.json and 4 more (ARKit, 3D Scanner App) are not read")
    for frame in frames:
        frame.unlink()
    for name in ("notes.txt", "report.xml", "scene.json", "camera.jpg.txt", "._poses.npy", "points.npz", "a.log"):
        (folder / name).write_text("1 2 3\n{}")
    (folder / "cam").mkdir()
    shutil.copy(folder / "images" / "000.png", folder / "cam")
    remarks = choose_photographs(folder).remarks
    assert remarks == ("cameras in camera.jpg.txt are not read; those of transforms.json are used.",)
