"""Plane-sweep matching against a straightforward warp, and on a scene whose depth is known."""

from collections.abc import Callable

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, pixel_rays
from fecocodec.sender.extractors.depthsplat_small.cost_volume import nearest_views
from fecocodec.sender.extractors.plane_sweep import cost_volume, from_all_pairs, from_sampled_rows, source_views
from tests.example_scenes import cameras_in_a_row, example_cameras


def unit_features(num_views: int, height: int, width: int, *, with_gradients: bool = False) -> Tensor:
    """With gradients another way of computing is taken than without."""
    generator = torch.Generator().manual_seed(0)
    features = F.normalize(torch.randn(1, num_views, 8, height, width, generator=generator), dim=2)
    return features.requires_grad_(with_gradients)


def warped_cost_volume(features: Tensor, cameras: Cameras, sources: Tensor, num_candidates: int) -> Tensor:
    """One scene: warp every source map to the reference at every candidate, multiply, average."""
    _, views, _, height, width = features.shape
    disparities = torch.linspace(float(1 / cameras.far), float(1 / cameras.near), num_candidates)
    rays = pixel_rays(cameras, height, width)
    volume = torch.zeros(1, views, num_candidates, height, width)
    for view in range(views):
        for source in sources[0, view].tolist():
            to_source = cameras.world_to_camera[source] @ cameras.extrinsics[view]
            for candidate, disparity in enumerate(disparities):
                points = (rays[view] / disparity) @ to_source[:3, :3].T + to_source[:3, 3]
                projected = points @ cameras.intrinsics[source].T
                uv = torch.where(points[..., 2:] > 1e-6, projected[..., :2] / points[..., 2:], torch.tensor(9.0))
                warped = F.grid_sample(features[0, source][None], 2 * uv[None] - 1, align_corners=False)[0]
                volume[0, view, candidate] += (features[0, view] * warped).sum(dim=0) / sources.shape[2]
    return volume


@pytest.mark.parametrize("with_gradients", [True, False])
@pytest.mark.parametrize(("num_views", "height", "width"), [(2, 16, 16), (4, 9, 14)])
def test_it_equals_warping_and_multiplying(num_views: int, height: int, width: int, with_gradients: bool) -> None:
    cameras = example_cameras(num_views, near=1.0, far=9.0)
    features = unit_features(num_views, height, width, with_gradients=with_gradients)
    sources = nearest_views(cameras.as_batch(), 2)
    found = cost_volume(features, cameras.as_batch(), sources, 12)
    assert found.requires_grad == with_gradients
    expected = warped_cost_volume(features.detach(), cameras, sources, 12)
    assert float(expected.abs().max()) > 0.5
    torch.testing.assert_close(found, expected, atol=2e-4, rtol=0)


def test_views_that_show_nothing_of_each_other_match_nothing() -> None:
    cameras = example_cameras(2)
    cameras.extrinsics[1, :3, :3] = cameras.extrinsics[0, :3, :3] @ torch.diag(torch.tensor([-1.0, 1.0, -1.0]))
    features = unit_features(2, 8, 8)
    volume = cost_volume(features, cameras.as_batch(), nearest_views(cameras.as_batch(), 1), 6)
    assert float(volume.abs().max()) == 0.0
    cameras = example_cameras(1).as_batch()
    sources = nearest_views(cameras, 2)
    assert sources.shape == (1, 1, 0)
    assert float(cost_volume(unit_features(1, 8, 8), cameras, sources, 6).abs().max()) == 0.0


@pytest.mark.parametrize("pick", [from_all_pairs, from_sampled_rows])
@pytest.mark.parametrize("max_products", [1, 500, 70_000, 2**24])
def test_ways_and_sizes_of_chunks_give_the_same(pick: Callable[..., Tensor], max_products: int) -> None:
    generator = torch.Generator().manual_seed(0)
    queries, keys = torch.randn(384, 8, generator=generator), torch.randn(8, 384, generator=generator)
    index = torch.randint(384, (384, 6, 4), generator=generator)
    weight = torch.rand(384, 6, 4, generator=generator)
    expected = torch.einsum("pc,cpdk,pdk->pd", queries, keys[:, index], weight)
    torch.testing.assert_close(pick(queries, keys, index, weight, max_products), expected, atol=1e-4, rtol=0)


def test_sources_are_the_nearest_other_views() -> None:
    cameras = example_cameras(6)
    centres = cameras.extrinsics[:, :3, 3]
    for view, row in enumerate(nearest_views(cameras.as_batch(), 2)[0].tolist()):
        order = (centres - centres[view]).norm(dim=-1).argsort().tolist()
        assert row == [other for other in order if other != view][:2]


@pytest.mark.parametrize("candidate", [6, 11, 16])
def test_the_best_candidate_of_a_textured_plane_is_its_depth(candidate: int) -> None:
    """Two cameras side by side see a fronto-parallel plane that lies exactly at one candidate."""
    num_candidates, near, far, height, width = 24, 1.0, 20.0, 16, 32
    disparity = 1 / far + candidate / (num_candidates - 1) * (1 / near - 1 / far)
    shift_px = 4  # the baseline that moves this plane by whole pixels
    cameras = cameras_in_a_row(0.0, shift_px / (disparity * width), focal=(1.0, 2.0), near=near, far=far).as_batch()
    texture = F.normalize(torch.randn(16, height, width + shift_px, generator=torch.Generator().manual_seed(2)), dim=0)
    features = torch.stack((texture[..., :width], texture[..., shift_px:]))[None]
    volume = cost_volume(features, cameras, nearest_views(cameras, 1), num_candidates)
    seen_by_both = volume[0, 0, :, :, shift_px + 1 : -1].argmax(dim=0)
    assert float((seen_by_both == candidate).float().mean()) > 0.97


def test_sources_overlap_with_the_view_and_have_parallax() -> None:
    """The first of six cameras in a row has a neighbour that looks back, and one nearly at its place."""
    cameras = cameras_in_a_row(0.0, 0.1, 0.2, 0.4, 0.6, 0.8)
    cameras.extrinsics[1, :3, :3] = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))
    cameras.extrinsics[2, :3, 3] = cameras.extrinsics[0, :3, 3] + torch.tensor([1e-3, 0.0, 0.0])
    sources = source_views(cameras.as_batch(), 2)[0].tolist()
    assert sources[0] == [3, 4] and sources[5] == [4, 3]
    assert nearest_views(cameras.as_batch(), 2)[0, 0].tolist() == [2, 1]
    pair = source_views(cameras.select([0, 1]).as_batch(), 2)
    assert pair.tolist() == [[[1], [0]]]  # the only one, although it looks back
    assert source_views(cameras.select([0]).as_batch(), 2).shape == (1, 1, 0)
