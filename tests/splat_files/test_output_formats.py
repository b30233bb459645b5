"""Each output format, read by other implementations: gsply and PlayCanvas' splat-transform."""

import gzip
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import gsply
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fecocodec.camera_files.transforms_json import read_transforms_json
from fecocodec.errors import OutputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import render
from fecocodec.splat_files.camera_json import write_camera_json
from fecocodec.splat_files.gaussian_arrays import RDF_TO_RUB, CameraArrays, OutputGaussians, gaussian_arrays
from fecocodec.splat_files.gaussian_files import NO_VERTICAL, decoded_file, in_frame, write_gaussians
from fecocodec.splat_files.ply import read_ply

CONVERTER = shutil.which("splat-transform")
needs_converter = pytest.mark.skipif(CONVERTER is None, reason="`npm install -g @playcanvas/splat-transform`")
HALF_TURN_ABOUT_Y = np.array([-1.0, 1.0, -1.0])


def some_gaussians(count: int = 3000, d_sh: int = 4, seed: int = 0) -> OutputGaussians:
    generator = np.random.default_rng(seed)
    rotations = generator.normal(size=(count, 4))
    return OutputGaussians(
        means=generator.normal(size=(count, 3)) * (3, 2, 1) + (0.5, -0.5, 5),
        scales=np.exp(generator.normal(size=(count, 3)) - 4),
        rotations=rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        opacities=generator.uniform(0.01, 0.99, count),
        harmonics=generator.normal(size=(count, d_sh, 3)) * 0.25,
    )


def some_cameras(num_views: int = 2) -> CameraArrays:
    angle = 0.3
    extrinsics = np.tile(np.eye(4), (num_views, 1, 1))
    extrinsics[:, :3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    extrinsics[:, 0, 3] = np.arange(num_views) + 1
    intrinsics = np.tile([[0.9, 0, 0.5], [0, 1.2, 0.5], [0, 0, 1]], (num_views, 1, 1))
    return CameraArrays(extrinsics, intrinsics, near=1.0, far=20.0, image_size=(96, 128))


def converted(path: Path) -> OutputGaussians:
    """Return the Gaussians of a file as splat-transform reads them."""
    target = path.with_name("converted.ply")
    subprocess.run([str(CONVERTER), "-w", "-q", str(path), str(target)], check=True, capture_output=True)
    return gaussian_arrays(read_ply(target), "converted")


def matched(sent: OutputGaussians, received: OutputGaussians) -> OutputGaussians:
    """Return the received Gaussians in the order of those sent: formats may reorder them."""
    distance = np.linalg.norm(sent.means[:, None] - received.means[None], axis=2)
    nearest = distance.argmin(axis=1)
    assert len(set(nearest)) == sent.count
    return received.ordered(nearest)


def covariances(gaussians: OutputGaussians) -> np.ndarray:
    axes = Rotation.from_quat(gaussians.rotations[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nik,nk,njk->nij", axes, gaussians.scales**2, axes)


def assert_alike(sent: OutputGaussians, received: OutputGaussians, harmonics: float, shape: float) -> None:
    """Compare with the tolerances of 8-bit formats: positions to 2e-4 of the extent."""
    received = matched(sent, received)
    extent = np.ptp(sent.means, axis=0).max()
    assert np.abs(received.means - sent.means).max() < 2e-4 * extent
    assert np.abs(received.opacities - sent.opacities).max() < 0.005
    assert np.sqrt(np.mean((received.harmonics[:, 0] - sent.harmonics[:, 0]) ** 2)) < 0.02
    assert np.sqrt(np.mean((received.harmonics[:, 1:] - sent.harmonics[:, 1:]) ** 2)) < harmonics
    expected = covariances(sent)
    error = np.linalg.norm(covariances(received) - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert np.quantile(error, 0.95) < shape


@needs_converter
@pytest.mark.parametrize(
    ("name", "version", "harmonics", "shape"),
    [
        ("scene.ply", 4, 1e-6, 1e-5),
        ("scene.compressed.ply", 4, 0.02, 0.03),
        ("scene.spz", 4, 0.005, 0.08),
        ("scene.spz", 3, 0.005, 0.08),
        ("scene.sog", 4, 0.12, 0.08),
    ],
)
def test_the_converter_of_a_viewer_reads_the_same_gaussians(name, version, harmonics, shape, tmp_path):
    gaussians = some_gaussians()
    write_gaussians(tmp_path / name, gaussians, spz_version=version)
    expected = gaussians.padded(3) if name == "scene.ply" else gaussians
    assert_alike(expected, converted(tmp_path / name), harmonics, shape)


@pytest.mark.parametrize("d_sh", [4, 9])
@pytest.mark.parametrize(
    ("name", "reader", "axes", "harmonics", "shape"),
    [
        ("scene.compressed.ply", gsply.plyread, np.eye(4), 0.02, 0.03),
        ("scene.spz", gsply.read_spz, RDF_TO_RUB, 0.005, 0.08),
    ],
)
def test_gsply_reads_the_same_gaussians(name, reader, axes, harmonics, shape, d_sh, tmp_path):
    gaussians = some_gaussians(d_sh=d_sh)
    write_gaussians(tmp_path / name, gaussians)
    read = reader(str(tmp_path / name))
    received = OutputGaussians(
        read.means.astype(np.float64),
        np.exp(read.scales.astype(np.float64)),
        read.quats.astype(np.float64),
        1 / (1 + np.exp(-read.opacities.astype(np.float64))),
        np.concatenate((read.sh0[:, None], read.shN), axis=1).astype(np.float64),
    )
    assert_alike(gaussians.transformed(axes), received, harmonics, shape)


def read_glb(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    data = path.read_bytes()
    assert struct.unpack("<3I", data[:12]) == (0x46546C67, 2, len(data))
    length = struct.unpack("<I", data[12:16])[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    attributes = {}
    for name, index in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        part = binary[view["byteOffset"] :][: view["byteLength"]]
        attributes[name] = np.frombuffer(part, kind).reshape(accessor["count"], -1).astype(np.float64)
    return document, attributes


@needs_converter
def test_glb_equals_that_of_the_converter_turned_about_the_vertical_axis(tmp_path):
    gaussians = some_gaussians(count=500)
    for name in ("scene.ply", "scene.glb"):
        write_gaussians(tmp_path / name, gaussians, sh_degree=1)
    command = [str(CONVERTER), "-q", str(tmp_path / "scene.ply"), str(tmp_path / "theirs.glb")]
    subprocess.run(command, check=True, capture_output=True)
    (ours_document, ours), (theirs_document, theirs) = (read_glb(tmp_path / n) for n in ("scene.glb", "theirs.glb"))
    assert ours_document["extensionsUsed"] == theirs_document["extensionsUsed"]
    primitives = [document["meshes"][0]["primitives"][0] for document in (ours_document, theirs_document)]
    assert primitives[0]["extensions"] == primitives[1]["extensions"]
    assert set(ours) == set(theirs)
    np.testing.assert_allclose(ours["POSITION"], theirs["POSITION"] * HALF_TURN_ABOUT_Y, atol=1e-6)
    signs = {"SH_DEGREE_1_COEF_1": -1, "SH_DEGREE_1_COEF_2": -1}  # linear in z and in x
    for name in set(ours) - {"POSITION", "KHR_gaussian_splatting:ROTATION"}:
        sign = signs.get(name.removeprefix("KHR_gaussian_splatting:"), 1)
        np.testing.assert_allclose(ours[name], sign * theirs[name], atol=2e-6, err_msg=name)


def test_glb_carries_the_cameras(tmp_path):
    cameras = some_cameras()
    write_gaussians(tmp_path / "scene.glb", some_gaussians(count=5), cameras)
    document, _ = read_glb(tmp_path / "scene.glb")
    nodes = [node for node in document["nodes"] if "camera" in node]
    assert [node["camera"] for node in nodes] == [0, 1]
    pose = np.array(nodes[1]["matrix"]).reshape(4, 4).T
    flip = np.diag([1, -1, -1])
    np.testing.assert_allclose(pose[:3, 3], flip @ cameras.extrinsics[1, :3, 3])
    np.testing.assert_allclose(pose[:3, :3] @ [0, 0, -1], flip @ cameras.extrinsics[1, :3, 2], atol=1e-12)
    lens = document["cameras"][0]["perspective"]
    assert lens["aspectRatio"] == pytest.approx(1.2 / 0.9)
    assert np.tan(lens["yfov"] / 2) == pytest.approx(0.5 / 1.2)


def rendered(gaussians: OutputGaussians, cameras: CameraArrays) -> torch.Tensor:
    tensors = Gaussians(*(torch.from_numpy(field.astype(np.float32)) for field in gaussians.fields()))
    poses = Cameras(
        torch.from_numpy(cameras.extrinsics.astype(np.float32)),
        torch.from_numpy(cameras.intrinsics.astype(np.float32)),
        torch.tensor(cameras.near),
        torch.tensor(cameras.far),
    )
    return render(tensors, poses, cameras.image_size).color


@pytest.mark.parametrize("d_sh", [1, 4, 9])
def test_the_frame_of_the_first_camera_renders_alike(d_sh):
    gaussians, cameras = some_gaussians(count=800, d_sh=d_sh), some_cameras()
    moved, moved_cameras, _ = in_frame("first-camera", gaussians, cameras)
    np.testing.assert_allclose(moved_cameras.extrinsics[0], np.eye(4), atol=1e-12)
    before, after = rendered(gaussians, cameras), rendered(moved, moved_cameras)
    assert before.std() > 0.05
    torch.testing.assert_close(after, before, rtol=0, atol=2e-3)


def tilted_cameras(tilt: np.ndarray) -> CameraArrays:
    """Return cameras that turn about the vertical and look up and down, all of them tilted by a rotation."""
    cameras = some_cameras(5)
    turns = Rotation.from_euler("YX", [[-20, -25], [-5, 0], [0, -10], [15, 5], [30, -30]], degrees=True)
    cameras.extrinsics[:, :3, :3] = turns.as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = tilt
    return cameras.transformed(pose)


def test_the_upright_frame_renders_alike_and_is_level():
    cameras = tilted_cameras(Rotation.from_euler("ZX", [25, 40], degrees=True).as_matrix())
    gaussians = some_gaussians(count=800)
    moved, moved_cameras, note = in_frame("upright", gaussians, cameras)
    before, after = rendered(gaussians, cameras), rendered(moved, moved_cameras)
    assert before.std() > 0.05
    torch.testing.assert_close(after, before, rtol=0, atol=2e-3)
    assert note is None
    assert np.abs(moved_cameras.extrinsics[:, 1, 0]).max() < np.sin(np.radians(1))  # right axes are level
    np.testing.assert_allclose(moved_cameras.extrinsics[0, :3, 3], 0, atol=1e-12)
    assert moved_cameras.extrinsics[0, 2, 2] > 0.8


def test_cameras_that_do_not_show_which_way_is_up_are_told():
    cameras = some_cameras(4)
    headings = Rotation.from_euler("YX", [[heading, -90] for heading in (0, 90, 180, 270)], degrees=True)
    cameras.extrinsics[:, :3, :3] = headings.as_matrix()
    _, moved, note = in_frame("upright", some_gaussians(10), cameras)
    assert note == NO_VERTICAL
    np.testing.assert_allclose(moved.extrinsics[0], np.eye(4), atol=1e-12)


def test_harmonics_above_degree_2_turn_only_if_they_are_zero():
    gaussians, cameras = some_gaussians(count=50), some_cameras()
    moved, _, _ = in_frame("first-camera", gaussians, cameras)
    padded, _, _ = in_frame("first-camera", gaussians.padded(3), cameras)
    assert np.array_equal(padded.harmonics[:, :4], moved.harmonics) and padded.harmonics.shape[1] == 16
    with pytest.raises(OutputError, match="harmonics above degree 2 cannot be changed"):
        in_frame("first-camera", some_gaussians(count=50, d_sh=16), cameras)


def decoded_scene(cameras: CameraArrays) -> SimpleNamespace:
    fields = (cameras.extrinsics, cameras.intrinsics, cameras.near, cameras.far)
    of_cameras = SimpleNamespace(fields=lambda: fields)
    return SimpleNamespace(gaussians=some_gaussians(10), cameras=of_cameras, image_size=(96, 128))


@pytest.mark.parametrize("ending", ["spz", "compressed.ply", "glb", "sog"])
def test_other_formats_than_ply_keep_the_degree_of_the_model(ending):
    """Zeros are written where they are asked for, also in formats whose axes differ."""
    decoded, path = decoded_scene(some_cameras()), Path(f"a.{ending}")
    sizes = [len(decoded_file(decoded, path, frame="first-camera", sh_degree=of).data) for of in (None, 1, 3)]
    assert sizes[0] == sizes[1] < sizes[2]


def test_saved_cameras_follow_the_frame_that_was_asked_for_and_not_that_of_the_format(tmp_path):
    cameras = tilted_cameras(np.diag([-1.0, -1.0, 1.0]))
    decoded = decoded_scene(cameras)
    ply, glb, level, as_input = (
        decoded_file(decoded, tmp_path / name, frame=frame)
        for name, frame in (("a.ply", None), ("a.glb", None), ("b.glb", "upright"), ("c.glb", "input"))
    )
    assert np.array_equal(ply.cameras.extrinsics, cameras.extrinsics)
    assert np.array_equal(glb.cameras.extrinsics, cameras.extrinsics)
    assert glb.data == level.data != as_input.data
    assert level.cameras.extrinsics[0, 1, 1] > 0.8 > cameras.extrinsics[0, 1, 1]


def test_spz_is_of_version_3_unless_4_is_asked_for(tmp_path):
    write_gaussians(tmp_path / "three.spz", some_gaussians(count=5))
    write_gaussians(tmp_path / "four.spz", some_gaussians(count=5), spz_version=4)
    assert struct.unpack("<2I", gzip.decompress((tmp_path / "three.spz").read_bytes())[:8]) == (0x5053474E, 3)
    assert struct.unpack("<2I", (tmp_path / "four.spz").read_bytes()[:8]) == (0x5053474E, 4)


def test_layouts_of_cameras(tmp_path):
    cameras = some_cameras()
    write_camera_json(tmp_path / "transforms.json", cameras, ["00.png", "01.png"])
    read = read_transforms_json(tmp_path / "transforms.json")
    assert (read.near, read.far) == (1.0, 20.0)
    for photograph, pose in zip(read.photographs, cameras.extrinsics, strict=True):
        np.testing.assert_allclose(photograph.camera_to_world, pose, atol=1e-12)
        lens = photograph.lens_for(128, 96)
        assert (lens.fx, lens.fy, lens.cx) == pytest.approx((0.9 * 128, 1.2 * 96, 64))
    cameras = some_cameras()
    write_camera_json(tmp_path / "cameras.json", cameras, ["00.png", "01.png"])
    entries = json.loads((tmp_path / "cameras.json").read_text())
    assert set(entries[0]) == {"id", "img_name", "width", "height", "position", "rotation", "fx", "fy"}
    np.testing.assert_allclose(entries[1]["rotation"], cameras.extrinsics[1, :3, :3])
    np.testing.assert_allclose(entries[1]["position"], cameras.extrinsics[1, :3, 3])
    assert entries[0]["fx"] == pytest.approx(0.9 * 128)


@pytest.mark.parametrize("name", ["scene.compressed.ply", "scene.spz", "scene.sog", "scene.glb"])
def test_formats_that_need_a_gaussian_refuse_none(name, tmp_path):
    with pytest.raises(OutputError, match=r"no Gaussians.*write a \.ply"):
        write_gaussians(tmp_path / name, some_gaussians(count=0))
    assert not list(tmp_path.iterdir())


def test_spz_refuses_coordinates_beyond_its_range(tmp_path):
    gaussians = some_gaussians(count=2)
    gaussians.means[0, 0] = 1e7
    with pytest.raises(OutputError, match=r"1e\+07 units from the origin.*another"):
        write_gaussians(tmp_path / "scene.spz", gaussians)


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_spz_keeps_positions_in_any_unit(scale, tmp_path):
    gaussians = some_gaussians(count=50)
    means = gaussians.means * scale
    write_gaussians(tmp_path / "scene.spz", OutputGaussians(means, *gaussians.fields()[1:]), spz_version=3)
    data = gzip.decompress((tmp_path / "scene.spz").read_bytes())
    bits = data[13]
    raw = np.frombuffer(data[16 : 16 + 9 * 50], np.uint8).reshape(150, 3).astype(np.int64)
    fixed = raw @ [1, 1 << 8, 1 << 16]
    received = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed).reshape(50, 3) / 2.0**bits * (1, -1, -1)
    assert np.abs(received - means).max() < 2e-4 * np.ptp(means, axis=0).max()


def test_a_library_that_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "fecocodec.splat_files.sog", raising=False)
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(
        OutputError, match=r"\.sog files need pillow and scipy, and pillow is not .* pip install pillow scipy"
    ):
        write_gaussians(tmp_path / "scene.sog", some_gaussians(8))
