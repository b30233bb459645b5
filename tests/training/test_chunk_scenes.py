"""Samples from chunks: frames of a stretch, cameras that follow the augmentation, refusals."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.camera_files.chunk_scene import VIDEO_BOUNDS
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.training.chunk_scenes import ChunkScenes, choose_stretch
from fecocodec.training.configurations import configuration_named
from fecocodec.training.samples import Sample
from fecocodec.training.sources import open_sources
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


def test_the_same_generator_state_gives_the_same_sample(tmp_path: Path) -> None:
    scenes = ChunkScenes(write_wall_chunks(tmp_path, num_frames=5))
    first, again, other = draw(scenes, 1), draw(scenes, 1), draw(scenes, 2)
    assert first.views.names == again.views.names and torch.equal(first.views.images, again.views.images)
    assert not torch.equal(first.views.images, other.views.images)


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


def test_scenes_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="100 scenes have no more than 3 frames; ask for fewer"):
        draw(ChunkScenes(write_wall_chunks(tmp_path / "short")), 0, num_context=3)
    mixed = record("mixed", shots(4))
    mixed["cameras"][1:, 0] *= 1.2
    with pytest.raises(InputError, match="scene mixed: its frames differ in size or lens"):
        draw(ChunkScenes(write_chunks(tmp_path / "mixed", [[mixed]])), 0, num_target=2)


def test_the_trainer_opens_chunks_where_photographs_are_named(tmp_path: Path) -> None:
    sources = open_sources(write_wall_chunks(tmp_path), None, configuration_named("paper-re10k"))
    assert isinstance(sources.photographs, ChunkScenes)
