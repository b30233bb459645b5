"""Every camera format gives views whose pixels are what their cameras say."""

import json
import struct
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from wall_scene import (
    edited,
    shots,
    take,
    transforms,
    wall_colour,
    wall_depth,
    write_colmap_binary,
    write_colmap_text,
    write_realestate10k,
    write_transforms,
)

from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import pixel_rays
from fecocodec.geometry.depth_range import estimate_depth_range
from fecocodec.geometry.views import Views
from fecocodec.photographs.exr import write_exr

WRITERS = [write_transforms, write_colmap_text, write_colmap_binary, write_realestate10k]
BARREL = {"k1": -0.2, "k2": 0.03, "p1": 0.004, "p2": -0.003}
PINCUSHION = {"k1": 0.15, "k2": 0.02}

read = partial(read_views, near=1.0, far=9.0)  # spares the tests of something else the plane sweep


def mean_colour_error(views: Views) -> float:
    """Mean difference between the images and the wall as the returned cameras see it."""
    rays = pixel_rays(views.cameras, *views.image_size).double().numpy()
    poses = views.cameras.extrinsics.double().numpy()
    expected = [wall_colour(pose[:3, 3], ray @ pose[:3, :3].T) for pose, ray in zip(poses, rays, strict=True)]
    images = views.images.permute(0, 2, 3, 1).numpy()
    return float(np.abs(images - np.stack(expected)).mean())


@pytest.mark.parametrize("write", WRITERS)
def test_pixels_agree_with_cameras(write, tmp_path):
    taken = shots(3)
    views = read(str(write(tmp_path / "scene", taken)))
    assert views.images.shape == (3, 3, 80, 96)
    assert (views.names, views.notes) == (("000.png", "001.png", "002.png"), ())
    poses = np.stack([shot.camera_to_world for shot in taken])
    np.testing.assert_allclose(views.cameras.extrinsics.numpy(), poses, atol=1e-6)
    np.testing.assert_allclose(views.cameras.intrinsics_px(80, 96)[0, :2, 2].numpy(), (47.0, 41.5), atol=1e-4)
    assert mean_colour_error(views) < 0.002


@pytest.mark.parametrize("distortion", [BARREL, PINCUSHION])
@pytest.mark.parametrize("write", [write_transforms, write_colmap_text, write_colmap_binary])
def test_lens_distortion_is_removed(write, distortion, tmp_path):
    taken = shots(2, distortion=distortion)
    views = read(write(tmp_path / "scene", taken))
    assert mean_colour_error(views) < 0.003
    pixels_if_ignored = torch.from_numpy(take(taken[0])).permute(2, 0, 1)[None]
    camera_if_ignored = views.select([0]).cameras
    assert views.image_size != (80, 96)
    ignored = Views(pixels_if_ignored.float(), camera_if_ignored, ("000.png",))
    assert mean_colour_error(ignored) > 0.01


RATIONAL = BARREL | {"k3": 0.01, "k4": 0.05, "k5": -0.02, "k6": 0.004}
FISHEYE = {"k1": -0.05, "k2": 0.01, "k3": -0.003, "k4": 0.001}


@pytest.mark.parametrize(
    ("written", "focal", "distortion"),
    [
        ("SIMPLE_PINHOLE", 100.0, {}),
        ("PINHOLE", 100.0, {}),
        ("SIMPLE_RADIAL", 100.0, {"k1": -0.2}),
        ("RADIAL", 100.0, {"k1": -0.2, "k2": 0.03}),
        ("OPENCV", 100.0, BARREL),
        ("FULL_OPENCV", 70.0, RATIONAL),
        ("OPENCV_FISHEYE", 70.0, FISHEYE),
        ("RADIAL_FISHEYE", 70.0, {"k1": -0.05, "k2": 0.01}),
        ("SIMPLE_RADIAL_FISHEYE", 70.0, {"k1": -0.05}),
        ("SIMPLE_FISHEYE", 70.0, {}),
        ("FISHEYE", 70.0, {}),
    ],
)
@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_colmap_camera_models(write, written, focal, distortion, tmp_path):
    model = "OPENCV_FISHEYE" if "FISHEYE" in written else "FULL_OPENCV" if written == "FULL_OPENCV" else "OPENCV"
    taken = shots(2, fx=focal, fy=focal, distortion=distortion, model=model)
    assert mean_colour_error(read(write(tmp_path / "scene", taken, written))) < (0.003 if focal > 70.0 else 0.004)


@pytest.mark.parametrize(("model", "distortion"), [("FULL_OPENCV", RATIONAL), ("OPENCV_FISHEYE", FISHEYE)])
def test_wide_and_rational_lenses_of_nerfstudio(model, distortion, tmp_path):
    taken = shots(2, fx=70.0, fy=70.0, distortion=distortion, model=model)
    folder = write_transforms(tmp_path / "scene", taken)
    views = read(folder)
    assert mean_colour_error(views) < 0.004
    with edited(folder) as scene:
        for frame in scene["frames"]:
            frame["camera_model"] = frame["camera_model"].lower()
    assert torch.equal(read(folder).images, views.images)
    if model == "OPENCV_FISHEYE":
        with edited(folder) as scene:  # as instant-ngp names it
            scene["is_fisheye"] = True
            for frame in scene["frames"]:
                del frame["camera_model"]
        assert torch.equal(read(folder).images, views.images)


def test_distortion_params_of_nerfstudio_are_k1_to_k4_p1_p2(tmp_path):
    """They take precedence over the same values, as in nerfstudio."""
    distortion = BARREL | {"k3": 0.01, "k4": -0.02}
    folder = write_transforms(tmp_path / "scene", shots(2, distortion=distortion))
    views = read(folder)
    assert mean_colour_error(views) < 0.003
    with edited(folder) as scene:
        scene["k1"] = 0.7
        for frame in scene["frames"]:
            frame["distortion_params"] = [frame.pop(key) for key in ("k1", "k2", "k3", "k4", "p1", "p2")]
    assert torch.equal(read(folder).images, views.images)
    with edited(folder) as scene:
        scene["frames"][1]["distortion_params"] = [0.1, 0.2]
    with pytest.raises(
        InputError, match=r"frame 1 \(images/001.png\), distortion_params: 6 numbers expected, 2 numbers"
    ):
        read(folder, views=(1,))


def test_null_is_no_value(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2, distortion=BARREL))
    views = read(folder)
    with edited(folder) as scene:
        shared = {key: scene["frames"][0][key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", *BARREL)}
        for frame in scene["frames"]:
            frame |= dict.fromkeys((*shared, "distortion_params", "camera_model"))
        scene |= {"near": None, "far": None, "camera_model": None, "k3": None} | shared
    assert torch.equal(read(folder).images, views.images)


@pytest.mark.parametrize("where", ["sparse/0", "sparse", "."])
def test_colmap_model_is_found(where, tmp_path):
    folder = write_colmap_binary(tmp_path / "scene", shots(2), where=where)
    assert mean_colour_error(read(folder)) < 0.002
    assert mean_colour_error(read(folder / where)) < 0.002


@pytest.mark.parametrize("size", [(64, 64), (80, 64), (64, 120), (160, 160), (67, 91)])
def test_centre_crop_and_resize(size, tmp_path):
    views = read(write_transforms(tmp_path / "scene", shots(2)), size=size)
    assert views.image_size == size
    assert mean_colour_error(views) < 0.004


def test_camera_made_for_another_size_of_the_image(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    with edited(folder) as scene:
        for frame in scene["frames"]:
            frame |= {key: 4 * frame[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")}
    assert mean_colour_error(read(folder)) < 0.002


def test_frames_of_different_size_get_the_most_frequent_one(tmp_path):
    first, *others = shots(4)
    larger = replace(first, width=144, height=120, fx=150.0, fy=156.0, cx=70.5, cy=62.25)
    wider = replace(others[0], width=120, cx=60.0)
    views = read(write_transforms(tmp_path / "scene", [larger, wider, *others[1:]]))
    assert views.image_size == (80, 96)
    assert mean_colour_error(views) < 0.003


def test_large_images_are_scaled_to_1024(tmp_path):
    large = {"width": 1280, "height": 160, "fx": 1300.0, "fy": 1300.0, "cx": 640.0, "cy": 80.0}
    views = read(write_transforms(tmp_path / "scene", shots(1, **large)))
    assert views.image_size == (128, 1024)
    assert mean_colour_error(views) < 0.002


def test_field_of_view_and_file_names_without_suffix_as_instant_ngp_writes_them(tmp_path):
    taken = shots(2, fy=100.0, cx=48.0, cy=40.0)
    folder = write_transforms(tmp_path / "scene", taken)
    frames = [
        {"file_path": f"./images/{shot.name[:3]}", "transform_matrix": frame["transform_matrix"]}
        for shot, frame in zip(taken, transforms(taken)["frames"], strict=True)
    ]
    scene = {"camera_angle_x": float(2 * np.arctan(48 / 100)), "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(scene))
    assert mean_colour_error(read(folder)) < 0.002


def test_the_camera_file_itself_may_be_given(tmp_path):
    folder = write_transforms(tmp_path / "a", shots(2))
    assert mean_colour_error(read(folder / "transforms.json")) < 0.002
    folder = write_realestate10k(tmp_path / "b", shots(2))
    assert mean_colour_error(read(folder / "clip.txt")) < 0.002
    text = (folder / "clip.txt").read_text()
    (folder / "clip.txt").write_text(text.replace(" ", ", "))  # as tables are exported
    assert mean_colour_error(read(folder)) < 0.002


def test_exr_photographs(tmp_path):
    taken = [replace(shot, name=shot.name.replace("png", "exr")) for shot in shots(2)]
    folder = tmp_path / "scene"
    (folder / "images").mkdir(parents=True)
    (folder / "transforms.json").write_text(json.dumps(transforms(taken)))
    for shot in taken:
        colour = torch.from_numpy(take(shot)).permute(2, 0, 1).float()
        write_exr(folder / "images" / shot.name, colour)
    views = read(folder)
    assert mean_colour_error(views) < 1e-4 and views.remarks == ()
    colour[1, :8] = torch.nan
    write_exr(folder / "images" / shot.name, colour, overwrite=True)
    assert read(folder).remarks == (
        "1 photograph has values that are NaN or negative, which become 0 (at most 10% of the pixels, of 001.exr); "
        "store them again without.",
    )


def test_views_are_chosen_in_the_order_asked_for(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(4))
    views = read(folder, views=(3, "001.png", "000", "images/002.png"))
    assert views.names == ("003.png", "001.png", "000.png", "002.png")
    assert mean_colour_error(views) < 0.002


def test_depth_bounds_come_from_the_caller_then_the_file(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2), near=1.5, far=9.0)
    cameras = read_views(folder).cameras
    assert (cameras.near.item(), cameras.far.item()) == (1.5, 9.0)
    cameras = read_views(folder, near=2.0).cameras
    assert (cameras.near.item(), cameras.far.item()) == (2.0, 9.0)


def test_stated_bounds_that_miss_the_scene_are_replaced_and_told(tmp_path):
    """A camera file whose depths have another unit than its positions; bounds that the caller gives are kept."""
    folder = write_transforms(tmp_path / "scene", shots(3), near=150.0, far=900.0)
    views = read_views(folder)
    assert 0.5 < views.cameras.near.item() < views.cameras.far.item() < 20.0
    assert "near and far are 150 and 900, but matching finds the scene between " in views.remarks[-1]
    given = read_views(folder, near=150.0, far=900.0)
    assert (given.cameras.near.item(), given.cameras.far.item()) == (150.0, 900.0) and not given.remarks


@pytest.mark.parametrize("write", WRITERS)
def test_missing_depth_bounds_enclose_the_wall_closely(write, tmp_path):
    taken = shots(3)
    cameras = read_views(write(tmp_path / "scene", taken)).cameras
    rays = pixel_rays(cameras, 80, 96).double().numpy()
    depths = np.stack([wall_depth(shot.camera_to_world, ray) for shot, ray in zip(taken, rays, strict=True)])
    assert 0.5 * depths.min() < cameras.near.item() < depths.min()
    assert depths.max() < cameras.far.item() < 2 * depths.max()


def test_small_errors_of_a_rotation_are_mended(tmp_path):
    shot = shots(1)[0]
    bent = shot.camera_to_world.copy()
    bent[:3, :3] += np.random.default_rng(0).uniform(-4e-4, 4e-4, (3, 3))
    folder = write_transforms(tmp_path / "scene", [shot])
    (folder / "transforms.json").write_text(json.dumps(transforms([replace(shot, camera_to_world=bent)])))
    rotation = read(folder).cameras.extrinsics[0, :3, :3].double()
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3, dtype=torch.float64), atol=2e-7, rtol=0)
    np.testing.assert_allclose(rotation.numpy(), shot.camera_to_world[:3, :3], atol=1e-3)


def test_an_unrelated_text_file_is_not_taken_for_cameras(tmp_path):
    folder = write_realestate10k(tmp_path / "scene", shots(2))
    (folder / "a_note.txt").write_bytes(b"caf\xe9\nnot cameras\n")
    (folder / "a_folder.txt").mkdir()
    assert read(folder).names == ("000.png", "001.png")


def test_photographs_beside_the_colmap_model(tmp_path):
    folder = write_colmap_text(tmp_path / "scene", shots(2))
    for image in (folder / "images").iterdir():
        image.rename(folder / image.name)
    (folder / "images").rmdir()
    assert mean_colour_error(read(folder)) < 0.002


def test_several_sizes_and_orientations_are_noted(tmp_path):
    views = read(write_transforms(tmp_path, [*shots(3), shots(4, width=96, height=72)[3]]))
    assert views.notes == (
        "the photographs have several sizes (3 of 96x80, 1 of 96x72); all are cropped and resized to 96x80; choose "
        "photographs of one size by `views`.",
    )
    landscape, portrait = shots(3, width=96, height=80), shots(4, width=80, height=96)[3]
    views = read(write_transforms(tmp_path, [*landscape, portrait]))
    assert "several orientations (3 of 96x80, 1 of 80x96)" in views.notes[0]


def test_sizes_are_those_of_the_stored_photographs(tmp_path):
    taken = [replace(shot, distortion=BARREL) for shot in [*shots(3), shots(4, width=96, height=72)[3]]]
    views = read(write_transforms(tmp_path, taken))
    assert views.image_size != (80, 96)
    assert "several sizes (3 of 96x80, 1 of 96x72)" in views.notes[0]
    narrow = replace(shots(4, width=32, height=96, cx=16.0)[3], distortion=BARREL)
    with pytest.raises(InputError, match=r"003.png: 32x96 pixels, while the other images are 96x80"):
        read(write_transforms(tmp_path / "narrow", [*taken[:3], narrow]))


@pytest.mark.parametrize("orientation", [1, 3])
def test_an_exif_orientation_that_is_not_applied_is_noted(tmp_path, orientation):
    folder = write_transforms(tmp_path, shots(2))
    path = next(tmp_path.rglob("001.png"))
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.open(path).save(path, exif=exif)
    notes = read(folder).notes
    assert notes == () if orientation == 1 else notes[0].startswith("001.png has an EXIF orientation, which is not")


def test_damaged_exif_data_have_no_orientation(tmp_path):
    folder = write_transforms(tmp_path, shots(2))
    path = next(tmp_path.rglob("001.png"))
    Image.open(path).save(path, exif=b"Exif\0\0MM\0*\xff\xff\xff\xff")
    assert read(folder).notes == ()


def test_a_crop_of_more_than_a_quarter_is_noted(tmp_path):
    folder = write_transforms(tmp_path, shots(2, width=144, height=80))
    assert read(folder, size=(64, 80)).notes == (
        "the crop to 80x64 leaves 69% of 000.png (144x80) and of 1 other; choose a `size` of the photographs' shape to "
        "keep more.",
    )
    assert read(folder, size=(64, 96)).notes == ()


def test_reduced_images_whose_field_of_view_is_known_are_read_as_they_are(tmp_path):
    taken = shots(2)
    folder = write_transforms(tmp_path, taken)
    expected = read(folder).cameras.intrinsics
    with edited(folder) as cameras:
        for values, shot in zip(cameras["frames"], taken, strict=True):
            for source in (cameras, values):
                for key in ("w", "h", "cx", "cy"):
                    source.pop(key, None)
            values |= {"fl_x": 4 * shot.fx, "fl_y": 4 * shot.fy, "camera_angle_x": 2 * np.arctan(96 / 2 / shot.fx)}
    views = read(folder)
    assert views.notes == ()
    torch.testing.assert_close(views.cameras.intrinsics[:, [0, 1], [0, 1]], expected[:, [0, 1], [0, 1]])


def test_more_than_16_photographs_are_thinned_to_views_that_overlap(tmp_path):
    views = read(write_transforms(tmp_path, shots(18)))
    assert 1 < len(views.names) <= 8
    assert views.notes[0].startswith(f"{len(views.names)} of 18 photographs are used (")
    assert views.notes[0].endswith("); choose others by `views`.")


def test_transparency_is_kept_beside_the_images(tmp_path):
    folder = write_transforms(tmp_path, shots(2))
    assert read(folder).alpha is None
    with Image.open(folder / "images" / "001.png") as image:
        pixels = image.convert("RGBA")
    pixels.putalpha(51)
    pixels.save(folder / "images" / "001.png")
    views = read(folder)
    torch.testing.assert_close(views.alpha, torch.tensor([1.0, 0.2])[:, None, None].expand(2, 80, 96))
    assert torch.equal(views.select([1]).alpha, views.alpha[1:])
    on_white, on_black = (read(folder, background=colour) for colour in ("white", "black"))
    assert on_white.alpha is None and on_black.alpha is None
    assert torch.equal(on_white.images, views.images)
    torch.testing.assert_close(on_white.images[1] - on_black.images[1], torch.full((3, 80, 96), 0.8))
    assert torch.equal(on_black.images[0], views.images[0])


@pytest.mark.parametrize(("factor", "is_noted"), [(1.0, False), (2.0, True), (4.0, True)])
def test_a_focal_length_in_pixels_of_a_larger_image_is_noted(factor, is_noted, tmp_path):
    """Without w, h and a principal point, only the field of view shows that the images were reduced."""
    folder = write_transforms(tmp_path / "scene", shots(2), near=1.5, far=9.0)
    with edited(folder) as scene:
        for frame in scene["frames"]:
            for key in ("w", "h", "cx", "cy"):
                del frame[key]
            frame["fl_x"], frame["fl_y"] = factor * frame["fl_x"], factor * frame["fl_y"]
    start = f"the focal length of 000.png is {factor * 100:.0f} pixels for an image of 96x80, a narrow"
    notes = read(folder).notes
    assert [note.startswith(start) for note in notes] == ([True] if is_noted else [])


@pytest.mark.parametrize("kind", ["TIFF", "PNG", "WEBP"])
def test_files_of_several_pictures_are_noted(kind, tmp_path):
    folder = write_transforms(tmp_path, shots(3))
    images = [Image.open(path).convert("RGB") for path in sorted((folder / "images").iterdir())]
    images[0].save(folder / "images" / "000.png", kind, save_all=True, append_images=images[1:], lossless=True)
    images[1].save(folder / "images" / "001.png", "MPO", save_all=True, append_images=images[:1])
    assert read(folder).remarks == ("000.png holds several pictures; the first is used.",)


def test_photographs_of_linear_light_are_noted(tmp_path):
    folder = write_transforms(tmp_path, shots(3))
    for path in (folder / "images").iterdir():
        info = PngInfo()
        info.add(b"gAMA", struct.pack(">I", 100_000))
        Image.open(path).save(path, pnginfo=info)
    assert read(folder).remarks == (
        "3 photographs are converted to sRGB from the values of gamma 1 that a gAMA chunk states, which is linear "
        "light; store them without it if it is wrong.",
    )


SCENE = Path(__file__).resolve().parents[2] / "examples" / "motorcycle"


def test_it_is_small_and_its_cameras_fit_its_photographs():
    assert sum(file.stat().st_size for file in SCENE.rglob("*") if file.is_file()) < 1_000_000
    text = (SCENE / "README.md").read_text()
    assert "Middlebury" in text
    assert "## Terms" in text
    # Depths found by matching the photographs agree with the ground truth that near and far were taken from.
    views = read_views(SCENE)
    assert views.images.shape == (2, 3, 256, 384)
    assert views.cameras.extrinsics[1, 0, 3].item() == pytest.approx(0.193001)
    near, far = estimate_depth_range(views)
    assert near == pytest.approx(views.cameras.near.item() / 1.3, rel=0.1)
    assert far == pytest.approx(views.cameras.far.item() * 1.3, rel=0.1)
