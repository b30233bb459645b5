"""Photographs as samples: cameras that follow every crop, scaling and flip."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.photographs.images import write_image
from fecocodec.training.photographs import Photographs
from fecocodec.training.samples import Sample, mirrored
from tests.wall_scene import edited

HEIGHT, WIDTH, FOCAL = 96, 128, 110.0
POINTS = np.array([[0.0, 0.0, 0.0], [0.25, -0.2, 0.3], [-0.3, 0.2, 0.2]])
"""World positions of a red, a green and a blue ball; distinct in every view."""


def camera_at(angle: float) -> np.ndarray:
    """Camera-to-world, OpenCV axes, three units from the origin and looking at it."""
    eye = np.array([3 * np.sin(angle), -0.2 * np.cos(5 * angle), -3 * np.cos(angle)])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack((right, np.cross(forward, right), forward, eye), axis=1)
    return pose


def photograph(pose: np.ndarray) -> Float[Tensor, "3 h w"]:
    """Three soft balls on black."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    seen = (POINTS - pose[:3, 3]) @ pose[:3, :3]
    u, v = (FOCAL * seen[:, 0] / seen[:, 2] + 60.0), (FOCAL * seen[:, 1] / seen[:, 2] + 50.0)
    spots = [np.exp(-((columns - u[i]) ** 2 + (rows - v[i]) ** 2) / 18) for i in range(3)]
    return torch.from_numpy(np.stack(spots)).float()


def write_scene(folder: Path, num_frames: int = 7) -> Path:
    (folder / "images").mkdir(parents=True)
    frames = []
    for index in range(num_frames):
        pose = camera_at(0.1 * index)
        write_image(folder / "images" / f"{index:03}.png", photograph(pose))
        opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": f"images/{index:03}.png", "transform_matrix": opengl.tolist()})
    gaps = np.abs(np.subtract.outer(np.arange(num_frames), np.arange(num_frames)))
    text = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": 60.0, "cy": 50.0, "w": WIDTH, "h": HEIGHT, "near": 2.0, "far": 5.0}
    (folder / "transforms.json").write_text(
        json.dumps(text | {"frames": frames, "covisibility": (1 - 0.15 * gaps).clip(0).tolist()})
    )
    return folder


@pytest.fixture
def photographs(tmp_path: Path) -> Photographs:
    write_scene(tmp_path / "balls")
    return Photographs(tmp_path)


def draw(photographs: Photographs, seed: int, num_context: int = 2, size: tuple[int, int] = (64, 64)) -> Sample:
    generator = torch.Generator().manual_seed(seed)
    return photographs.sample(generator, num_context=num_context, num_target=2, size=size)


def brightest(channel: Float[Tensor, "h w"]) -> Float[Tensor, "2"] | None:
    """Normalised (u, v) of the ball in a channel, None where it touches the border or is out of the image."""
    peak = divmod(int(channel.argmax()), channel.shape[1])
    height, width = channel.shape
    if channel.max() < 0.5 or not (4 < peak[0] < height - 5 and 4 < peak[1] < width - 5):
        return None
    weight = channel**4
    rows = ((torch.arange(height) + 0.5) / height * weight.sum(1)).sum() / weight.sum()
    columns = ((torch.arange(width) + 0.5) / width * weight.sum(0)).sum() / weight.sum()
    return torch.stack((columns, rows))


def triangulated(cameras: Cameras, seen: dict[int, Float[Tensor, "2"]]) -> Float[Tensor, "3"]:
    """The world point closest to the rays through these image positions, least squares."""
    rows, values = [], []
    for view, uv in seen.items():
        projection = (cameras.intrinsics[view] @ cameras.world_to_camera[view, :3]).double()
        for axis in range(2):
            equation = projection[axis] - uv[axis] * projection[2]
            rows.append(equation[:3])
            values.append(-equation[3])
    return torch.linalg.lstsq(torch.stack(rows), torch.stack(values)[:, None]).solution[:, 0]


@pytest.mark.parametrize("size", [(64, 64), (48, 80), (80, 40)])
def test_cameras_agree_with_what_the_images_show(photographs: Photographs, size: tuple[int, int]) -> None:
    num_checked, mirror_signs = 0, set()
    for seed in range(30):
        sample = draw(photographs, seed, size=size)
        for ball, place in enumerate(POINTS):
            found = {view: brightest(image[ball]) for view, image in enumerate(sample.views.images)}
            seen = {view: uv for view, uv in found.items() if uv is not None}
            if len({sample.views.names[view] for view in seen}) < 2:
                continue
            point = triangulated(sample.views.cameras, seen).numpy()
            nearest = min((np.linalg.norm(point - place * [sign, 1, 1]), sign) for sign in (1, -1))
            assert nearest[0] < 0.06
            num_checked += 1
            if abs(place[0]) > 0.1:
                mirror_signs.add(nearest[1])
    assert num_checked >= 15
    assert mirror_signs == {1, -1}


def test_frames_that_are_drawn(photographs: Photographs) -> None:
    for seed in range(40):
        sample = draw(photographs, seed)
        frames = [int(name[:3]) for name in sample.views.names]
        first, second, *targets = frames
        assert 0.3 < 1 - 0.15 * abs(first - second) < 0.9
        assert all(1 - 0.15 * abs(first - target) > 0.3 and 1 - 0.15 * abs(second - target) > 0.3 for target in targets)
        assert len(set(frames)) == 4
    sample = draw(photographs, 1, num_context=4)
    frames = sorted(int(name[:3]) for name in sample.views.names[:4])
    assert len(set(frames)) == 4 and max(np.diff(frames)) <= 4
    assert sample.views.images.shape == (6, 3, 64, 64) and sample.depth is None
    first, again, other = (draw(photographs, seed).views for seed in (2, 2, 3))
    assert torch.equal(first.images, again.images) and not torch.equal(first.images, other.images)
    assert torch.equal(first.cameras.intrinsics, again.cameras.intrinsics)
    determinants = torch.linalg.det(mirrored(first).cameras.extrinsics[:, :3, :3])
    torch.testing.assert_close(determinants, torch.ones(4))
    with pytest.raises(InputError, match="num_context = 9"):
        draw(photographs, 0, num_context=9)


def test_overlap_comes_from_the_poses_where_no_covisibility_is_written(tmp_path: Path) -> None:
    with edited(write_scene(tmp_path / "balls")) as text:
        del text["covisibility"]
    frames = [sorted(int(name[:3]) for name in draw(Photographs(tmp_path), seed).views.names[:2]) for seed in range(20)]
    assert all(first < second for first, second in frames)


def test_bounds_that_are_missing_and_an_image_of_another_size_are_named(tmp_path: Path) -> None:
    folder = write_scene(tmp_path / "balls", num_frames=2)
    for key in ("near", "far"):
        with edited(folder) as text:
            value = text.pop(key)
        with pytest.raises(InputError, match="no near and far with 0 < near < far"):
            Photographs(tmp_path)
        with edited(folder) as text:
            text[key] = value
    write_image(folder / "images" / "001.png", torch.zeros(3, 20, 20), overwrite=True)
    with pytest.raises(InputError, match=r"001\.png"):
        draw(Photographs(tmp_path), 0)
