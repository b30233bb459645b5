"""Samples from chunks: frames of a stretch, cameras that follow the augmentation, refusals.

Context and target frames of captures: overlap, baseline, and overlap from poses alone.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fecocodec.camera_files.chunks import VIDEO_BOUNDS
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.geometry.frustum_overlap import frustum_overlap
from fecocodec.training.chunk_scenes import ChunkScenes, choose_stretch
from fecocodec.training.photographs import LEAST_OVERLAP, choose_frames, context_pairs, relative_baselines
from fecocodec.training.samples import Sample
from tests.chunk_files import record, write_chunks, write_wall_chunks
from tests.wall_scene import shots, wall_colour


def draw(scenes: ChunkScenes, seed: int, num_context: int = 2, num_target: int = 1) -> Sample:
    generator = torch.Generator().manual_seed(seed)
    return scenes.sample(generator, num_context=num_context, num_target=num_target, size=(64, 64))


def correlation_with_the_wall(sample: Sample, mirror: float) -> float:
    """Tinting changes colours but not where they are: compare with what the cameras should see of the wall."""
    cameras = sample.views.cameras
    flip = np.array([mirror, 1.0, 1.0])
    rays = camera_to_world_points(cameras, pixel_rays(cameras, 64, 64)).double().numpy()
    centres = cameras.extrinsics[:, :3, 3].double().numpy()
    wall = np.stack([wall_colour(c * flip, (ray - c) * flip) for c, ray in zip(centres, rays, strict=True)])
    return float(np.corrcoef(wall.ravel(), sample.views.images.permute(0, 2, 3, 1).numpy().ravel())[0, 1])


def test_cameras_follow_crop_scale_and_mirror(tmp_path: Path) -> None:
    scenes = ChunkScenes(write_wall_chunks(tmp_path))
    for seed in range(6):
        sample = draw(scenes, seed)
        assert sample.num_context == 2 and sample.depth is None
        assert (sample.views.cameras.near, sample.views.cameras.far) == VIDEO_BOUNDS
        assert max(correlation_with_the_wall(sample, mirror) for mirror in (1.0, -1.0)) > 0.97


@pytest.mark.parametrize(("num_frames", "num_context"), [(300, 2), (300, 8), (60, 2), (9, 8), (3, 2), (40, 1)])
def test_context_views_span_a_stretch_and_targets_lie_inside(num_frames: int, num_context: int) -> None:
    for seed in range(50):
        frames = choose_stretch(np.random.default_rng(seed), num_frames, (45, 192), num_context, 3)
        context, targets = frames[:num_context], frames[num_context:]
        assert len(set(context)) == num_context and len(targets) == 3
        assert min(frames) >= 0 and max(frames) < num_frames
        assert set(targets).isdisjoint(context)
        if num_context > 1:
            gap = max(context) - min(context)
            assert min(45, num_frames - 1) <= gap <= 192
            assert min(context) < min(targets) and max(targets) < max(context)


def test_frames_of_several_lenses_are_refused(tmp_path: Path) -> None:
    mixed = record("mixed", shots(4))
    mixed["cameras"][1:, 0] *= 1.2
    with pytest.raises(InputError, match="scene mixed: its frames differ in size or lens"):
        draw(ChunkScenes(write_chunks(tmp_path / "mixed", [[mixed]])), 0, num_target=2)


LENS = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])


def cameras(positions: list[float], turns_deg: list[float] | None = None) -> np.ndarray:
    """Camera-to-world of cameras along x that look along z, turned about the vertical."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, 0, 3] = positions
    if turns_deg is not None:
        poses[:, :3, :3] = Rotation.from_euler("y", np.array(turns_deg)[:, None], degrees=True).as_matrix()
    return poses


def overlap_of(poses: np.ndarray, near: float = 4.0, far: float = 6.0) -> np.ndarray:
    return frustum_overlap(poses, np.tile(LENS, (len(poses), 1, 1)), near, far)


def test_overlap_falls_with_distance_and_has_no_unit() -> None:
    overlap = overlap_of(cameras([0.0, 1.0, 2.5, 20.0]))
    assert np.array_equal(overlap, overlap.T) and np.array_equal(np.diag(overlap), np.ones(4))
    assert overlap[0, 1] > overlap[0, 2] > overlap[0, 3] == 0.0
    # A step of one at depth d hides a strip of width 1/d: about 0.2 of the image between 4 and 6.
    assert abs(overlap[0, 1] - 0.8) < 0.07
    assert overlap_of(cameras([0.0, 0.0], [0.0, 180.0]))[0, 1] == 0.0
    poses = cameras([0.0, 0.5, 1.3], [0.0, 5.0, -8.0])
    larger = poses.copy()
    larger[:, :3, 3] *= 1000.0
    np.testing.assert_allclose(overlap_of(poses), overlap_of(larger, 4000.0, 6000.0), atol=0.02)


def test_pairs_of_context_views() -> None:
    poses = cameras([0.0, 0.001, 1.5], [0.0, 15.0, 0.0])
    overlap, baselines = overlap_of(poses), relative_baselines(poses, 4.0, 6.0)
    assert LEAST_OVERLAP < overlap[0, 1] < 0.9
    assert (0, 1) not in context_pairs(overlap, baselines) and (0, 2) in context_pairs(overlap, baselines)
    np.testing.assert_allclose(baselines[0, 2], 1.5 / 4.8)
    overlap = np.array([[1.0, 0.1, 0.05], [0.1, 1.0, 0.2], [0.05, 0.2, 1.0]])
    assert context_pairs(overlap, np.ones((3, 3))) == [(1, 2)]


def test_frames_are_connected_and_come_in_both_orders() -> None:
    poses = cameras([0.4 * index for index in range(12)])
    overlap = overlap_of(poses)
    pairs = context_pairs(overlap, relative_baselines(poses, 4.0, 6.0))
    orders = set()
    for seed in range(30):
        frames = choose_frames(np.random.default_rng(seed), overlap, pairs, 3, 2)
        context, targets = frames[:3], frames[3:]
        assert len(set(context)) == 3 and not set(context) & set(targets)
        assert all(max(overlap[frame, other] for other in context if other != frame) > 0.3 for frame in context)
        assert all(np.sort(overlap[context, target])[-2] > LEAST_OVERLAP for target in targets)
        orders.add(context[0] < context[1])
    assert orders == {True, False}
