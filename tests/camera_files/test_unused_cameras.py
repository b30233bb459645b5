"""Cameras that are not used are named, wherever they lie around photographs whose cameras are estimated."""

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

from fecocodec.camera_files import camera_names
from fecocodec.camera_files.camera_names import walk
from fecocodec.camera_files.find import has_cameras, read_cameras
from fecocodec.camera_files.unused_cameras import earlier_estimate_notes, unread_cameras_notes
from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.render_cameras import read_render_cameras
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.scene_source import scene_source
from fecocodec.errors import InputError

CONVERT = "to use them, convert them to a transforms.json or a COLMAP model."
FURTHER_PROGRAMS = """
    pmvs/bundle.rd.out reconstruction_sequential/sfm_data.bin MeshroomCache/SfM/ab/cameras.sfm sfm.abc project.psx
    reconstruction.bin undistorted/reconstruction.json sensors/trajectories.txt Ori-All/Orient-a.xml scene.pkl scene.pt
    params/a_calibrated_camera_parameters.txt CameraTrajectory.txt KeyFrameTrajectory.txt cam2world.npy K.npy
    poses.jsonl frame_annotations.jgz cams.usd scan.rcproj odm_report/shots.geojson images/000.pose.txt sparse.zip
"""
POSES = "1 0 0 0 0 1 0 0 0 0 1 0\n"


def put(file: Path, content: object) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, np.ndarray):
        np.save(file, content)
    else:
        file.write_text(str(content))


@pytest.mark.parametrize(
    ("images", "file", "content", "shown"),
    [
        ("keyframes/images", "keyframes/corrected_cameras/0.json", "{}", "corrected_cameras"),
        ("image", "meta_data.json", "{}", "meta_data.json (sdfstudio)"),
        ("rgb", "groundtruth.txt", "", "groundtruth.txt (TUM RGB-D)"),
        ("image_2", "poses.txt", "", "poses.txt"),
        ("color", "pose/0.txt", "", "pose"),
        ("blended_images", "cams/00000000_cam.txt", "", "cams/00000000_cam.txt (MVSNet)"),
        ("rgb/1x", "camera/0.json", '{"orientation": []}', "camera/0.json (Nerfies)"),
        ("mav0/cam0/data", "mav0/state_groundtruth_estimate0/data.csv", "", "state_groundtruth_estimate0/data.csv"),
        ("images", "cameras.xml", "<document><chunk>", "cameras.xml (Metashape)"),
    ],
)
def test_cameras_above_and_beside_the_folder_of_the_photographs(
    images: str, file: str, content: str, shown: str, tmp_path: Path
) -> None:
    write_photographs(tmp_path / "scans" / "room" / images, shots(3))
    put(tmp_path / "scans" / "room" / file, content)
    (note,) = unread_cameras_notes(tmp_path / "scans" / "room" / images)
    assert note.startswith(f"cameras above the photographs ({shown}")
    assert note.endswith(f") are not read, and cameras are estimated; {CONVERT}")
    if images != "images":
        with pytest.raises(InputError) as refused:
            read_cameras(tmp_path / "scans" / "room")
        place = tmp_path / "scans" / "room" / images
        assert f"no photographs found here, but in {place}; give that folder, but cameras in " in str(refused.value)
        assert str(refused.value).endswith(f" are not read: {CONVERT}")


def test_folders_of_other_things_above_are_quiet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_photographs(tmp_path / "kitchen", shots(2))
    write_photographs(tmp_path / "camera_roll", shots(2))
    unrelated = "camera_roll/a.json", "camera/settings/a.json", "my old camera shots/a.json", "cams/hall.json"
    for file in (*unrelated, "cameras.zip"):
        put(tmp_path / file, "{}")
    assert unread_cameras_notes(tmp_path / "kitchen") == []
    put(tmp_path / "poses.npy", "")
    assert unread_cameras_notes(tmp_path / "kitchen")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))  # as of an archive that is unpacked
    assert unread_cameras_notes(tmp_path / "kitchen") == []


def test_another_scene_in_a_folder_below_is_quiet(tmp_path: Path) -> None:
    write_photographs(tmp_path, shots(4)[2:])
    write_transforms(tmp_path / "other", shots(2))
    assert unread_cameras_notes(tmp_path) == []
    shutil.rmtree(tmp_path / "other" / "images")
    assert unread_cameras_notes(tmp_path)


def test_cameras_above_that_are_read(tmp_path: Path) -> None:
    """Their folder is named if giving it helps, else where the images must be."""
    folder = write_transforms(tmp_path / "scene", shots(2))
    (note,) = unread_cameras_notes(folder / "images")
    to_use = f"to use them instead, give the folder {folder}."
    assert note == f"{folder / 'transforms.json'} has cameras, and cameras are estimated; {to_use}"
    shutil.copytree(folder / "images", folder / "others")
    assert unread_cameras_notes(folder / "others") == []
    shutil.rmtree(folder / "images")
    (note,) = unread_cameras_notes(folder / "others")
    assert note == (
        f"{folder / 'transforms.json'} has cameras of images with these names, but not in this folder, and cameras are "
        f"estimated; to use them, put the images into {folder / 'images'} and give the folder {folder}."
    )
    (folder / "transforms.json").write_text("broken")
    assert unread_cameras_notes(folder / "others") == []


def test_cameras_of_an_earlier_estimate_are_noted_but_no_warning(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    assert earlier_estimate_notes(folder / "images") == []
    file = (folder / "transforms.json").rename(folder / "cameras.json")
    file.write_text(json.dumps({**json.loads(file.read_text()), "is_estimated": True}))
    assert unread_cameras_notes(folder / "images") == []
    (note,) = earlier_estimate_notes(folder / "images")
    assert note == (
        f"{file} has cameras of an earlier estimate, but cameras are estimated again; to use those, give the folder "
        f"{folder}."
    )
    shutil.copytree(folder / "images", folder / "others")
    assert earlier_estimate_notes(folder / "others") == unread_cameras_notes(folder / "others") == []
    write_transforms(folder, shots(2))
    assert unread_cameras_notes(folder / "images") and earlier_estimate_notes(folder / "images") == []


@pytest.mark.parametrize("where", ["sparse/0/0", "colmap"])
def test_further_places_of_colmap_models(where: str, tmp_path: Path) -> None:
    """`colmap mapper --output_path sparse/0` writes the first, ScanNet++ has the second."""
    folder = write_colmap_binary(tmp_path / "scene", shots(2), where=where)
    assert choose_photographs(folder).names == ("000.png", "001.png")


@pytest.mark.parametrize("write", [write_transforms, write_cameras_json, write_llff, write_realestate10k])
@pytest.mark.parametrize("where", ["images", "output", "a/b/cameras"])
def test_other_cameras_farther_down(write: Callable[..., Path], where: str, tmp_path: Path) -> None:
    (file,) = (
        path for path in write(tmp_path / "other", shots(2)).iterdir() if path.suffix in (".json", ".npy", ".txt")
    )
    folder = tmp_path / "scene"
    write_photographs(folder / "images", shots(2))
    (folder / where).mkdir(parents=True, exist_ok=True)
    shutil.copy(file, folder / where)
    (note,) = unread_cameras_notes(folder)
    assert note.startswith(f"cameras in {where}/{file.name} are not looked for, and cameras are estimated; to use them")


POSES_UNDER_ANY_NAME = {
    "00.txt": POSES * 3,
    "logs/room.txt": "# t x y z\n" + "1.5 1 1 1 0 0 0 1\n" * 2,
    "list.csv": "file,x,y,z,qx,qy,qz,qw\n" + "000.png,1,1,1,0,0,0,1\n" * 3,
    "images/000.txt": "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
    "images/000.json": '{"camera_data": {"cam2world": []}}',
    "data.jsonl": '{"cameraToWorld": []}\n',
    "result.npy": np.zeros((3, 4, 4)),
}


@pytest.mark.parametrize(
    ("file", "content"),
    [*dict.fromkeys(FURTHER_PROGRAMS.split(), "# Bundle file").items(), *POSES_UNDER_ANY_NAME.items()],
)
def test_further_programs_and_poses_under_any_name(file: str, content: object, tmp_path: Path) -> None:
    write_photographs(tmp_path / "images", shots(3))
    put(tmp_path / file, content)
    (note,) = unread_cameras_notes(tmp_path)
    assert note.startswith(f"cameras in {file}")
    assert note.endswith(f"are not read, and cameras are estimated; {CONVERT}")


def test_what_lies_beside_photographs_without_cameras_is_quiet(tmp_path: Path) -> None:
    write_photographs(tmp_path / "images", shots(3))
    for folder in ("depth", "masks", "thumbnails", "cam0"):
        write_photographs(tmp_path / folder, shots(3))
    for file, content in {
        "README.txt": "Three photographs of a wall.",
        "notes.txt": " ".join(["word"] * 19),
        "LICENSE.txt": "as is",
        "images.txt": "# list\n000.png\n001.png\n",
        "geo.txt": "EPSG:4326\n000.png 1 2 3\n001.png 1 2 3\n",
        "labels/000.txt": "0 0.5 0.5 0.1 0.1\n1 0.5 0.5 0.1 0.1\n",
        "cloud.txt": POSES * 9,
        "captions.json": '{"000.png": "a wall"}',
        "images/000.png.json": '{"cameraMake": "x", "Orientation": 1}',
        "images/000_keypoints.json": '{"people": [{"pose_keypoints_2d": [1]}]}',
        "depth.npy": np.zeros((3, 80, 96)),
        "colmap.log": "done",
        "sparse/0/points3D.ply": "ply",
        "run.sh": "cd cameras",
        "camera_paths/a.json": "{}",
        "camera_path.json": '{"camera_path": []}',
    }.items():
        put(tmp_path / file, content)
    assert not has_cameras(tmp_path)
    assert unread_cameras_notes(tmp_path) == []


def test_huge_trees_are_not_walked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(20):
        put(tmp_path / "a" / str(number) / "b.txt", "")
    (tmp_path / "a" / "loop").symlink_to(tmp_path)
    assert sum(path.name == "b.txt" for path in walk(tmp_path)) == 20
    assert not any(path.name == "b.txt" for path in walk(tmp_path, 2))
    monkeypatch.setattr(camera_names, "_MOST_FOLDERS", 5)
    assert sum(path.name == "b.txt" for path in walk(tmp_path)) == 3


def test_errors_of_estimation_name_unread_cameras_and_photographs(tmp_path: Path) -> None:
    write_photographs(tmp_path, shots(1))
    put(tmp_path / "cameras.xml", "<chunk")
    for name in ("001.NEF", "002.NEF"):
        put(tmp_path / name, "")
    with pytest.raises(InputError) as refused, scene_source(tmp_path, EncodingOptions()):
        pass
    assert str(refused.value) == (
        f"{tmp_path}: one photograph without cameras, but cameras are estimated from two or more; add photographs or a "
        "camera file; 001.NEF, 002.NEF are of a kind that cannot be read; develop RAW photographs to JPEG, TIFF or "
        f"PNG; cameras in cameras.xml (Metashape) are not read; {CONVERT}"
    )


def test_rendering_names_unread_cameras_and_needs_no_photographs(tmp_path: Path) -> None:
    put(tmp_path / "scan" / "keyframes" / "cameras" / "0.json", "{}")
    for folder in (tmp_path / "scan", tmp_path / "scan" / "keyframes" / "images"):
        write_photographs(tmp_path / "scan" / "keyframes" / "images", shots(2))
        with pytest.raises(InputError) as refused:
            read_render_cameras(folder)
        assert str(refused.value).startswith(f"{folder}: no cameras found; cameras ")
        assert str(refused.value).endswith(f" are not read; {CONVERT}")
    write_transforms(tmp_path / "other", shots(2))
    (tmp_path / "scene" / "nerfstudio").mkdir(parents=True)
    (tmp_path / "other" / "transforms.json").rename(tmp_path / "scene" / "nerfstudio" / "transforms.json")
    with pytest.raises(
        InputError, match=r"no cameras found; cameras in nerfstudio/transforms\.json are not looked for; "
    ):
        read_render_cameras(tmp_path / "scene")


def test_folders_that_hold_only_folders_lead_to_cameras_that_can_be_read(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "data" / "scan", shots(2))
    with pytest.raises(InputError, match=rf"no photographs found here, but cameras in {folder}; give that\."):
        read_cameras(tmp_path / "data")
    folder = write_transforms(tmp_path / "others" / "a" / "b", shots(2))
    with pytest.raises(InputError, match=rf"but cameras in {folder}/transforms\.json; give that\."):
        read_cameras(tmp_path / "others")


@pytest.mark.parametrize("name", ["poses.txt", "traj.txt", "c2w.npy", "poses_bounds_train.npy"])
def test_camera_files_given_by_themselves(name: str, tmp_path: Path) -> None:
    put(tmp_path / name, "1")
    with pytest.raises(InputError) as refused:
        read_cameras(tmp_path / name)
    assert str(refused.value).startswith(f"{tmp_path / name}: cameras of this kind are not read; convert them to a ")
    put(tmp_path / "transforms.json", json.dumps([{"file_path": "a.png", "transform": []}]))
    with pytest.raises(InputError, match="as `ns-export cameras` writes it, which has no lenses; give the transforms"):
        read_cameras(tmp_path)


def test_images_of_cameras_below_in_another_folder(tmp_path: Path) -> None:
    """As in ScanNet++."""
    scene = write_colmap_text(tmp_path / "scan" / "dslr", shots(2), where="colmap")
    images = (scene / "images").rename(scene / "resized_images")
    with pytest.raises(InputError) as refused:
        read_cameras(tmp_path / "scan")
    assert str(refused.value) == (
        f"{tmp_path}/scan: no photographs found here, but in {images}; give that folder, but cameras in {scene}/colmap "
        "name images that are not there: to use them, put the photographs there."
    )
    (note,) = unread_cameras_notes(images)
    assert note.endswith(f"to use them, put the images into {scene}/images and give the folder {scene}.")
