"""Cameras to render at are those of the photographs, without the photographs; camera paths of nerfstudio are read."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from wall_scene import shots, write_colmap_binary, write_colmap_text, write_realestate10k, write_transforms

from fecocodec.captures.render_cameras import read_render_cameras
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError
from fecocodec.splat_files.camera_json import write_camera_json
from fecocodec.splat_files.gaussian_arrays import CameraArrays

BARREL = {"k1": -0.12, "k2": 0.02, "p1": 0.002, "p2": -0.001}


def remove_photographs(folder):
    for image in (folder / "images").iterdir():
        image.unlink()
    (folder / "images").rmdir()


def assert_same_cameras(found, expected):
    assert torch.equal(found.cameras.extrinsics, expected.cameras.extrinsics)
    assert torch.equal(found.cameras.intrinsics, expected.cameras.intrinsics)
    assert found.image_size == expected.image_size
    assert found.names == tuple(name.removesuffix(".png") for name in expected.names)


@pytest.mark.parametrize("write", [write_transforms, write_colmap_text, write_colmap_binary])
@pytest.mark.parametrize("size", [None, (64, 96)])
def test_photographs_are_not_needed(write, size, tmp_path):
    folder = write(tmp_path / "scene", shots(3, distortion=BARREL))
    expected = read_views(folder, views=(2, 0), size=size, near=1.0, far=9.0)
    remove_photographs(folder)
    assert_same_cameras(read_render_cameras(folder, views=(2, 0), size=size), expected)


def test_cameras_of_the_3dgs_reference_are_read(tmp_path):
    """As `decode --save-cameras cameras.json` writes them, and training with the reference implementation."""
    folder = write_transforms(tmp_path / "scene", shots(3))
    views = read_views(folder, near=1.0, far=9.0)
    remove_photographs(folder)
    cameras = CameraArrays(
        views.cameras.extrinsics.numpy(), views.cameras.intrinsics.numpy(), 1.0, 9.0, views.image_size
    )
    path = tmp_path / "scene" / "cameras.json"
    write_camera_json(path, cameras, list(views.names))
    found = read_render_cameras(path)
    assert torch.allclose(found.cameras.extrinsics, views.cameras.extrinsics, atol=1e-6)
    expected = views.cameras.intrinsics.clone()
    expected[:, :2, 2] = 0.5  # the format has no principal point
    assert torch.allclose(found.cameras.intrinsics, expected, atol=1e-6)
    assert found.image_size == views.image_size and not found.has_depth_bounds
    assert found.names == tuple(name.removesuffix(".png") for name in views.names)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"img_name": 3}, "camera 1: no `img_name`; name the image of this camera."),
        ({"rotation": [[1, 0, 0], [0, 1, 0]]}, "camera 1 (b), rotation: "),
        ({"fx": "wide"}, "camera 1 (b), width, height, fx, fy: "),
        ({"fy": 0}, "camera 1 (b): no positive focal length; give fx and fy in pixels."),
        ({"width": 0}, "camera 1 (b): width and height are no size of an image"),
    ],
)
def test_a_camera_of_the_3dgs_reference_that_is_not_valid_is_named(change, sentence, tmp_path):
    camera = {"img_name": "a", "width": 96, "height": 64, "position": [0, 0, 0], "fx": 90, "fy": 90}
    camera["rotation"] = np.eye(3).tolist()
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([camera, camera | {"img_name": "b"} | change]))
    assert [
        ("1 of 2 cameras of cameras.json is passed over (" in note) for note in read_render_cameras(path).notes
    ] == [True]
    with pytest.raises(InputError) as refused:
        read_render_cameras(path, views=(1,))
    assert str(refused.value).startswith(f"{path}, {sentence}")
    path.write_text("[]")
    with pytest.raises(InputError, match="no cameras; export it again"):
        read_render_cameras(path)


def test_views_that_are_called_alike_are_kept_apart(tmp_path):
    taken = [replace(shot, name=f"{side}/a.png") for shot, side in zip(shots(2), ("left", "right"), strict=True)]
    for side in ("left", "right"):
        (tmp_path / "images" / side).mkdir(parents=True)
    assert read_render_cameras(write_transforms(tmp_path, taken)).names == ("00_a", "01_a")


def test_depth_bounds_are_those_of_the_file_or_its_points(tmp_path):
    stated = write_transforms(tmp_path / "stated", shots(2), near=1.5, far=9.0)
    found = read_render_cameras(stated)
    assert found.has_depth_bounds and (found.cameras.near.item(), found.cameras.far.item()) == (1.5, 9.0)
    points = write_colmap_text(tmp_path / "points", shots(2))
    assert read_render_cameras(points).has_depth_bounds
    assert not read_render_cameras(write_transforms(tmp_path / "none", shots(2))).has_depth_bounds


def test_a_colmap_model_is_read_from_its_own_folder(tmp_path):
    folder = write_colmap_binary(tmp_path / "scene", shots(2))
    expected = read_views(folder)
    remove_photographs(folder)
    assert_same_cameras(read_render_cameras(folder / "sparse" / "0"), expected)


def test_a_format_without_sizes_needs_one(tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(2))
    expected = read_views(folder, near=1.0, far=9.0)
    for image in folder.glob("*.png"):
        image.unlink()
    with pytest.raises(InputError, match="the camera file states no image size; put the image there or give `size`"):
        read_render_cameras(folder)
    assert_same_cameras(read_render_cameras(folder, size=expected.image_size), expected)


def camera_path(poses, fov=50.0, **values):
    frames = [
        {"camera_to_world": (pose * [1, -1, -1, 1]).ravel().tolist(), "fov": fov, "aspect": 1.5} for pose in poses
    ]
    return {"camera_type": "perspective", "render_height": 80, "render_width": 120, "camera_path": frames, **values}


def test_a_camera_path_of_nerfstudio(tmp_path):
    """`fov` is vertical, in degrees; poses are camera-to-world in OpenGL axes, row by row."""
    poses = [shot.camera_to_world for shot in shots(12)]
    (tmp_path / "path.json").write_text(json.dumps(camera_path(poses, fps=24, seconds=0.5, is_cycle=False)))
    found = read_render_cameras(tmp_path / "path.json")
    np.testing.assert_allclose(found.cameras.extrinsics.numpy(), np.stack(poses), atol=1e-6)
    half_height = math.tan(math.radians(25.0))
    expected = [[1 / (3 * half_height), 0, 0.5], [0, 1 / (2 * half_height), 0.5], [0, 0, 1]]
    np.testing.assert_allclose(found.cameras.intrinsics[7].numpy(), expected, rtol=1e-6)
    assert (found.image_size, found.frames_per_second) == ((80, 120), 24.0)
    assert found.names[:2] == ("00", "01") and len(found.names) == 12


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"camera_path": []}, "the camera path has no cameras"),
        ({"camera_type": "fisheye"}, "cameras of type 'fisheye' are not supported"),
        ({"render_width": 0}, "are no size of an image"),
        ({"camera_path": [{"camera_to_world": [1.0] * 15, "fov": 50}]}, "camera 0, camera_to_world: 16 numbers"),
        ({"camera_path": [{"camera_to_world": [1.0] * 16, "fov": None}]}, "fov"),
        ({"camera_path": [{"camera_to_world": np.eye(4).ravel().tolist(), "fov": 180}]}, "180 degrees is not possible"),
        ({"camera_path": [7]}, "camera 0: this is not an object"),
        *(
            (
                {"camera_path": [{"camera_to_world": matrix, "fov": 50}]},
                "camera 0, camera_to_world: 16 numbers expected",
            )
            for matrix in ("text", {"a": 1}, [[1], [2, 3]], [[1, 2], [3, 4]], None)
        ),
    ],
)
def test_bad_camera_paths(change, sentence, tmp_path):
    (tmp_path / "path.json").write_text(json.dumps(camera_path([np.eye(4)]) | change))
    with pytest.raises(InputError, match=sentence):
        read_render_cameras(tmp_path / "path.json")


def test_a_camera_path_without_a_size(tmp_path):
    (tmp_path / "path.json").write_text(json.dumps({"camera_path": [{}]}))
    with pytest.raises(InputError, match=r"path\.json, render_width: a number expected"):
        read_render_cameras(tmp_path / "path.json")
