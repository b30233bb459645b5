"""`fecosplat render` at cameras of a file, along a path, and to a video."""

import json
from pathlib import Path

import av
import numpy as np
import pytest
import torch

from fecocodec import Gaussians, write_ply
from fecocodec.photographs.images import read_image


@pytest.fixture(scope="module")
def ply(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A coloured wall of Gaussians at depth 3 in front of the photographs' cameras (OpenCV axes, looking along -z)."""
    y, x = torch.meshgrid(torch.linspace(-2, 2, 40), torch.linspace(-2, 3, 40), indexing="ij")
    means = torch.stack((x, y, torch.full_like(x, -3.0)), dim=-1).reshape(-1, 3)
    colours = (0.5 + 0.5 * torch.sin(means * torch.tensor([3.0, 2.0, 1.0])) - 0.5) / 0.2820948
    rotations = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(len(means), 1)
    opacities = torch.full((len(means),), 0.95)
    file = tmp_path_factory.mktemp("ply") / "wall.ply"
    write_ply(file, Gaussians(means, torch.full_like(means, 0.08), rotations, opacities, colours[:, None]))
    return file


def test_cameras_need_no_photographs(fecosplat, ply: Path, photographs: Path, tmp_path: Path) -> None:
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "transforms.json").write_bytes((photographs / "transforms.json").read_bytes())
    with_photographs, without = tmp_path / "a.png", tmp_path / "b.png"
    options = ("--views", "view_2", "--background", "white", "--size", "64x80")
    assert fecosplat("render", ply, "-o", with_photographs, "--cameras", photographs, *options).code == 0
    assert fecosplat("render", ply, "-o", without, "--cameras", tmp_path / "cameras", *options).code == 0
    image = read_image(without)
    assert torch.equal(image, read_image(with_photographs)) and image.shape == (3, 80, 64)
    assert image.std() > 0.1  # the wall, not the background


def test_cameras_that_see_nothing_of_the_scene_are_named(fecosplat, ply, photographs, tmp_path) -> None:
    """A camera that is 1000 times as far away, in another unit of length, does not see the wall."""
    scene = json.loads((photographs / "transforms.json").read_text())
    for row in scene["frames"][1]["transform_matrix"][:3]:
        row[3] += 1000.0
    (tmp_path / "transforms.json").write_text(json.dumps(scene))
    run = fecosplat("render", ply, "-o", tmp_path / "out", "--cameras", tmp_path)
    assert run.code == 0
    (warning,) = (line for line in run.err.splitlines() if line.startswith("warning"))
    assert warning.startswith("warning: nothing of the scene is seen in view_1; give cameras in its frame")
    assert "warning" not in fecosplat("render", ply, "-o", tmp_path / "other", "--cameras", photographs).err


def test_depth_bounds_of_a_ply_come_from_its_gaussians(fecosplat, ply: Path, photographs: Path, tmp_path: Path) -> None:
    """Without bounds in the camera file, Gaussians in front of the cameras are still drawn, and no pixels are read."""
    scene = json.loads((photographs / "transforms.json").read_text())
    del scene["near"], scene["far"]
    (tmp_path / "transforms.json").write_text(json.dumps(scene))
    files = tmp_path / "a.png", tmp_path / "b.png"
    for file, cameras in zip(files, (photographs, tmp_path), strict=True):
        assert fecosplat("render", ply, "-o", file, "--cameras", cameras, "--views", "view_0.png").code == 0
    assert torch.equal(read_image(files[0]), read_image(files[1]))


def test_a_path_is_a_picture_a_frame_and_a_video(fecosplat, ply: Path, photographs: Path, tmp_path: Path) -> None:
    video, images = tmp_path / "flight.mp4", tmp_path / "images"
    options = ("--cameras", photographs, "--path", "between", "--frames", "7", "--fps", "25")
    result = fecosplat("render", ply, "-o", images, "--video", video, *options, "--json")
    assert result.code == 0 and json.loads(result.out)["outputs"][-1] == str(video)
    assert sorted(file.name for file in images.glob("*.png")) == [f"wall_{frame:02d}.png" for frame in range(7)]
    with av.open(str(video)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert (stream.average_rate, stream.codec_context.name) == (25, "h264")
    assert len(frames) == 7 and frames[0].shape == (64, 96, 3)
    for number, frame in enumerate(frames):
        picture = read_image(images / f"wall_{number:02d}.png").permute(1, 2, 0).numpy()
        assert np.abs(frame / 255 - picture).mean() < 0.05


def test_a_camera_path_of_nerfstudio_sets_size_and_rate(fecosplat, ply: Path, tmp_path: Path) -> None:
    frames = [{"camera_to_world": np.eye(4).ravel().tolist(), "fov": 50.0, "aspect": 1.5}] * 3
    path = {"camera_type": "perspective", "render_height": 81, "render_width": 120, "camera_path": frames, "fps": 24}
    (tmp_path / "path.json").write_text(json.dumps(path))
    result = fecosplat("render", ply, "--video", tmp_path / "a.mp4", "--cameras", tmp_path / "path.json")
    assert result.code == 0
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.average_rate, stream.width, stream.height) == (24, 120, 80)  # an odd row is left out


def test_a_video_without_its_package_is_one_sentence(fecosplat, ply, photographs, output, monkeypatch) -> None:
    monkeypatch.setattr("fecocodec.photographs.video_frames.find_spec", lambda _name: None)
    result = fecosplat("render", ply, "--video", output / "a.mp4", "--cameras", photographs)
    assert (result.code, list(output.iterdir())) == (1, [])
    assert (
        result.err
        == "fecosplat: writing a video needs the package av; run `pip install '.[video]'` in the project's folder.\n"
    )


def test_an_image_output_that_is_a_video_names_its_option(fecosplat, stream_file: Path, output: Path) -> None:
    result = fecosplat("render", stream_file, "-o", output / "a.mp4")
    assert result.code == 1 and f"use --video {output / 'a.mp4'}." in result.err


@pytest.mark.usefixtures("networks")
def test_a_video_alone_has_a_path_at_the_size_that_is_asked_for(fecosplat, wall: bytes, tmp_path: Path) -> None:
    (tmp_path / "wall.fcs").write_bytes(wall)
    video = tmp_path / "wall.mp4"
    result = fecosplat("render", tmp_path / "wall.fcs", "--video", video, "--frames", "5", "--size", "48x64")
    assert (result.code, "5 views rendered" in result.err) == (0, True), result.err
    with av.open(str(video)) as container:
        assert (container.streams.video[0].width, container.streams.video[0].height) == (48, 64)
