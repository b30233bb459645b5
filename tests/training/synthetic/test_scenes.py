"""Synthetic scenes: what their depth, cameras and images promise."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.training.samples import Sample
from fecocodec.training.synthetic.cameras import PathRange
from fecocodec.training.synthetic.scenes import SyntheticScenes, lay_out
from fecocodec.training.synthetic.textures import Textures, pattern_textures

SIZE = (64, 80)


@pytest.fixture(scope="module")
def textures() -> Textures:
    return pattern_textures(13)


def draw(world: SyntheticScenes, seed: int, num_context: int = 2, num_target: int = 1) -> Sample:
    generator = torch.Generator().manual_seed(seed)
    return world.sample(generator, num_context=num_context, num_target=num_target, size=SIZE)


def warped(sample: Sample, source: int, destination: int) -> tuple[Float[Tensor, "3 h w"], Float[Tensor, "h w"]]:
    """The source image as the destination camera would see it, and where the source really sees the same surface."""
    assert sample.depth is not None
    cameras, images = sample.views.cameras, sample.views.images
    one, other = cameras.select([destination]), cameras.select([source])
    rays = pixel_rays(one, *SIZE)
    points = camera_to_world_points(one, rays * sample.depth[destination][None, ..., None])[0]
    world_to_camera = other.world_to_camera[0]
    seen = points @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]
    projected = seen / seen[..., 2:] @ other.intrinsics[0].T
    grid = (projected[..., :2] * 2 - 1)[None]
    colour = F.grid_sample(images[source][None], grid, align_corners=False)[0]
    found = F.grid_sample(sample.depth[source][None, None], grid, align_corners=False)[0, 0]
    is_seen = (seen[..., 2] > 0) & (grid[0].abs() < 1).all(-1) & ((found / seen[..., 2] - 1).abs() < 0.01)
    return colour, is_seen


def test_depth_and_poses_carry_one_view_onto_another(textures: Textures) -> None:
    world = SyntheticScenes(textures)
    errors, unwarped, covered = [], [], []
    for seed in range(12):
        sample = draw(world, seed)
        colour, is_seen = warped(sample, source=1, destination=0)
        errors.append((colour - sample.views.images[0]).abs()[:, is_seen].mean())
        unwarped.append((sample.views.images[1] - sample.views.images[0]).abs().mean())
        covered.append(is_seen.float().mean())
    assert float(torch.stack(covered).mean()) > 0.5
    assert float(torch.stack(errors).mean()) < 0.03
    assert float(torch.stack(errors).mean()) < 0.35 * float(torch.stack(unwarped).mean())


def test_samples_repeat_and_may_have_many_views(textures: Textures) -> None:
    world = SyntheticScenes(textures)
    first, again, other = draw(world, 5), draw(world, 5), draw(world, 6)
    assert torch.equal(first.views.images, again.views.images)
    assert torch.equal(first.views.cameras.extrinsics, again.views.cameras.extrinsics)
    assert not torch.equal(first.views.images, other.views.images)
    generator = torch.Generator().manual_seed(0)
    sample = SyntheticScenes(textures).sample(generator, num_context=8, num_target=2, size=(48, 32))
    assert sample.views.images.shape == (10, 3, 48, 32) and sample.num_context == 8


def test_the_unit_of_length_changes_lengths_and_nothing_else(textures: Textures) -> None:
    metres, others = draw(SyntheticScenes(textures, decades=0.0), 3), draw(SyntheticScenes(textures, decades=4.0), 3)
    assert metres.depth is not None and others.depth is not None
    assert torch.equal(metres.views.images, others.views.images)
    unit = others.views.cameras.near / metres.views.cameras.near
    assert 1e-2 <= float(unit) <= 1e2 and abs(float(unit) - 1) > 1e-3
    torch.testing.assert_close(others.depth, metres.depth * unit)
    one, other = metres.views.cameras, others.views.cameras
    torch.testing.assert_close(other.far, one.far * unit)
    torch.testing.assert_close(other.extrinsics[:, :3, 3], one.extrinsics[:, :3, 3] * unit)
    torch.testing.assert_close(other.extrinsics[:, :3, :3], one.extrinsics[:, :3, :3])


def test_every_sample_is_finite_within_bounds_and_rigid(textures: Textures) -> None:
    world = SyntheticScenes(textures)
    for seed in range(20, 40):
        sample = draw(world, seed)
        assert sample.depth is not None
        cameras, images = sample.views.cameras, sample.views.images
        assert images.shape == (3, 3, *SIZE) and float(images.min()) >= 0 and float(images.max()) <= 1
        assert bool(sample.depth.isfinite().all()) and 0 < float(cameras.near) < float(cameras.far)
        within = ((sample.depth > cameras.near) & (sample.depth < cameras.far)).float().mean()
        assert float(within) > 0.97
        rotation = cameras.extrinsics[:, :3, :3]
        torch.testing.assert_close(rotation @ rotation.mT, torch.eye(3).expand(3, 3, 3), atol=1e-5, rtol=0)
        torch.testing.assert_close(torch.linalg.det(rotation), torch.ones(3), atol=1e-5, rtol=0)


def test_complexity_goes_from_bare_walls_to_crowded_rooms() -> None:
    def num_solids(complexity: float) -> float:
        layouts = [lay_out(np.random.default_rng(seed), 13, complexity) for seed in range(40)]
        return float(np.mean([len(stage.world.kinds) for stage in layouts]))

    bare, half_full, crowded = (num_solids(complexity) for complexity in (0.0, 0.5, 1.0))
    assert bare < 10 and half_full > 1.5 * bare and crowded > 1.5 * half_full


def test_baselines_follow_the_path_range(textures: Textures) -> None:
    def spread(path: PathRange) -> float:
        world = SyntheticScenes(textures, path=path)
        ratios = []
        for seed in range(12):
            sample = draw(world, seed)
            assert sample.depth is not None
            gap = torch.linalg.norm(sample.views.cameras.extrinsics[:2, :3, 3].diff(dim=0))
            ratios.append(float(gap / sample.depth[:2].median()))
        return float(np.median(ratios))

    assert spread(PathRange(baseline=(0.3, 0.5))) > 2 * spread(PathRange(baseline=(0.03, 0.05)))
