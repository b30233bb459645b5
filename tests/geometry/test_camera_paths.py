"""Camera paths are rigid, pass through or stay near the given cameras, and look at the scene."""

import math
from dataclasses import replace

import pytest
import torch

from fecocodec.geometry.camera_paths import between, camera_path
from fecocodec.geometry.cameras import Cameras
from tests.example_scenes import example_cameras


def ring(count: int, turn: float) -> Cameras:
    """Cameras on an arc of `turn` radians and radius 3 around the origin, looking at it."""
    poses = torch.eye(4).repeat(count, 1, 1)
    for pose, angle in zip(poses, torch.linspace(0, turn * (1 - 1 / count), count).tolist(), strict=True):
        pose[:3, 0] = torch.tensor((math.cos(angle), 0.0, math.sin(angle)))
        pose[:3, 2] = torch.tensor((-math.sin(angle), 0.0, math.cos(angle)))
        pose[:3, 3] = -3.0 * pose[:3, 2]
    intrinsics = torch.tensor([[0.9, 0.0, 0.5], [0.0, 1.2, 0.5], [0.0, 0.0, 1.0]]).repeat(count, 1, 1)
    return Cameras(poses, intrinsics, torch.tensor(2.0), torch.tensor(4.0))


def looking_outwards(count: int, turn: float) -> Cameras:
    """Cameras on the arc of `ring`, turned around: their axes cross behind them, as those of photographs of a room."""
    cameras = ring(count, turn)
    back = torch.diag(torch.tensor((-1.0, 1.0, -1.0, 1.0)))
    return replace(cameras, extrinsics=cameras.extrinsics @ back)


def seen_by(cameras: Cameras, depth: float) -> torch.Tensor:
    """A point at this depth on the axis of each camera."""
    return cameras.extrinsics[:, :3, 3] + depth * cameras.extrinsics[:, :3, 2]


def angles_of(cameras: Cameras) -> torch.Tensor:
    centres = cameras.extrinsics[:, :3, 3]
    return torch.rad2deg(torch.atan2(centres[:, 0], -centres[:, 2]))


@pytest.mark.parametrize("name", ["spiral", "orbit", "between"])
@pytest.mark.parametrize("views", [1, 2, 5])
def test_paths_are_rigid_and_smooth(name: str, views: int) -> None:
    cameras = example_cameras(views)
    path, note = camera_path(name, cameras, 40, seen_by(cameras, 3.0))
    assert note is None
    rotations = path.extrinsics[:, :3, :3]
    assert path.num_views == 40 and path.intrinsics.shape == (40, 3, 3)
    torch.testing.assert_close(rotations @ rotations.mT, torch.eye(3).expand(40, 3, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.det(rotations), torch.ones(40), atol=1e-5, rtol=0)
    steps = (path.extrinsics[1:, :3, 3] - path.extrinsics[:-1, :3, 3]).norm(dim=-1)
    assert float(steps.max()) < 0.5 * max(float(steps.sum()), 1e-6) or views == 1


def test_between_passes_through_every_camera_in_order() -> None:
    cameras = ring(5, math.pi / 2)
    shuffled = cameras.select([3, 0, 4, 1, 2])
    path = between(shuffled, 9)
    visited = path.extrinsics[::2]
    expected = (
        cameras.extrinsics
        if torch.allclose(visited[0], cameras.extrinsics[0], atol=1e-5)
        else (cameras.extrinsics.flip(0))
    )
    torch.testing.assert_close(visited, expected, atol=1e-5, rtol=0)


def test_between_turns_at_an_even_pace_and_never_to_and_fro() -> None:
    """Cameras turn while they walk; those at one end are near each other and look elsewhere."""
    walk = ring(8, math.pi)
    walk.extrinsics[4:, :3, 3] = walk.extrinsics[4, :3, 3] + 0.01 * walk.extrinsics[4:, :3, 2]
    path = between(walk.select([5, 2, 0, 7, 1, 4, 6, 3]), 57)
    turns = (path.extrinsics[1:, :3, 2] * path.extrinsics[:-1, :3, 2]).sum(dim=1).clamp(max=1).acos().rad2deg()
    assert float(turns.sum()) == pytest.approx(180 * 7 / 8, abs=1)
    assert float(turns.max()) < 2.5 * float(turns.mean())


def test_orbits() -> None:
    path, note = camera_path("orbit", ring(8, 2 * math.pi), 36, torch.zeros(1, 3))
    assert note is None
    centres, forward = path.extrinsics[:, :3, 3], path.extrinsics[:, :3, 2]
    torch.testing.assert_close(centres.norm(dim=1), torch.full((36,), 3.0), atol=0.02, rtol=0)
    torch.testing.assert_close(forward, -centres / 3.0, atol=0.02, rtol=0)
    assert sorted(angles_of(path).round().int().remainder(360).tolist()) == list(range(0, 360, 10))
    cameras = ring(4, math.pi / 3)
    captured, swung = angles_of(cameras), angles_of(camera_path("orbit", cameras, 60, torch.zeros(1, 3))[0])
    assert float(swung.max()) == pytest.approx(float(captured.max()), abs=1.0)
    assert float(swung.min()) == pytest.approx(float(captured.min()), abs=1.0)
    cameras = ring(4, math.radians(120))
    cosine, sine = math.cos(0.7), math.sin(0.7)
    down = torch.tensor([[1.0, 0.0, 0.0, 0.0], [0.0, cosine, sine, 0.0], [0.0, -sine, cosine, 0.0], [0, 0, 0, 1.0]])
    poses = cameras.extrinsics @ down
    poses[:, :3, 3] = -3.0 * poses[:, :3, 2]
    path, note = camera_path("orbit", replace(cameras, extrinsics=poses), 24, torch.zeros(1, 3))
    assert note is None and float(path.extrinsics[:, 1, 0].abs().max()) < 0.02  # right axes
    torch.testing.assert_close(path.extrinsics[:, 1, 3], poses[:1, 1, 3].expand(24), atol=0.02, rtol=0)
    # The axes of these cameras cross behind them, where an orbit would look at nothing.
    cameras = looking_outwards(4, math.radians(30))
    path, note = camera_path("orbit", cameras, 24, seen_by(cameras, 4.0))
    assert note is None
    middle = seen_by(cameras, 4.0).mean(dim=0)
    ray = torch.nn.functional.normalize(middle - path.extrinsics[:, :3, 3], dim=1)
    torch.testing.assert_close(path.extrinsics[:, :3, 2], ray, atol=1e-2, rtol=0)
    assert float(cameras.project(middle).depth.min()) > 3


def test_a_spiral_looks_at_the_focus_and_is_as_wide_as_the_cameras() -> None:
    cameras = ring(2, math.radians(20))
    path, _ = camera_path("spiral", cameras, 60, seen_by(cameras, 8 / 3))
    mean = cameras.extrinsics[:, :3, 3].mean(dim=0)
    baseline = (cameras.extrinsics[0, :3, 3] - cameras.extrinsics[1, :3, 3]).norm()
    offset = path.extrinsics[:, :3, 3] - mean
    assert 0.4 * baseline < offset.norm(dim=1).max() < 1.0 * baseline
    focus = mean + 8 / 3 * torch.nn.functional.normalize(cameras.extrinsics[:, :3, 2].mean(dim=0), dim=0)
    ray = torch.nn.functional.normalize(focus - path.extrinsics[:, :3, 3], dim=1)
    torch.testing.assert_close(path.extrinsics[:, :3, 2], ray, atol=1e-3, rtol=0)


@pytest.mark.parametrize("name", ["spiral", "orbit"])
def test_cameras_without_a_common_centre_get_a_path_through_them(name: str) -> None:
    cameras = looking_outwards(6, 2 * math.pi)
    path, note = camera_path(name, cameras, 24, seen_by(cameras, 4.0))
    assert note is not None and f"(between) and is no {name}" in note
    torch.testing.assert_close(path.extrinsics, between(cameras, 24).extrinsics)
