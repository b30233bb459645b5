"""The plane sweep: as the public code warps, and as geometry demands."""

import torch
import torch.nn.functional as F
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, pixel_rays
from fecocodec.sender.extractors.depthsplat_small.cost_volume import (
    candidate_depths,
    cost_volume,
    exact_positions,
    public_positions,
    source_views,
)
from tests.example_scenes import example_cameras

HEIGHT, WIDTH, CHANNELS = 10, 14, 8
CHECKED = slice(None, None, 9)  # of the candidates


def cameras_of_several_lenses(num_views: int) -> Cameras:
    cameras = example_cameras(num_views, near=0.5, far=100.0)
    intrinsics = cameras.intrinsics.clone()
    intrinsics[:, 0, 0] += 0.1 * torch.arange(num_views)
    intrinsics[:, 1, 2] -= 0.02 * torch.arange(num_views)
    return Cameras(cameras.extrinsics, intrinsics, cameras.near, cameras.far)


def random_features(num_views: int) -> Tensor:
    return torch.randn(1, num_views, CHANNELS, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))


def publicly_warped_cost(features: Tensor, cameras: Cameras, view: int, sources: list[int]) -> Tensor:
    """The steps of the public code, one candidate and one source at a time, in pixels; each lens is the view's own."""
    lenses = cameras.intrinsics.clone()
    lenses[:, 0] *= WIDTH
    lenses[:, 1] *= HEIGHT
    rows, columns = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    pixels = torch.stack((columns, rows, torch.ones_like(rows))).float().flatten(1)
    inverse_depths = torch.linspace(1 / float(cameras.far), 1 / float(cameras.near), 128)[CHECKED]
    costs = []
    for inverse_depth in inverse_depths:
        total = torch.zeros(HEIGHT, WIDTH)
        for source in sources:
            to_source = cameras.extrinsics[source].inverse() @ cameras.extrinsics[view]
            points = to_source[:3, :3] @ lenses[view].inverse() @ pixels / inverse_depth + to_source[:3, 3:]
            projected = lenses[source] @ points
            place = projected[:2] / projected[2:].clamp(min=1e-3)
            grid = torch.stack((2 * place[0] / (WIDTH - 1) - 1, 2 * place[1] / (HEIGHT - 1) - 1), dim=-1)
            warped = F.grid_sample(
                features[source][None], grid.view(1, HEIGHT, WIDTH, 2), mode="bilinear", padding_mode="zeros",
                align_corners=True,
            )[0]  # fmt: skip
            total += (features[view] * warped).sum(0) / CHANNELS**0.5
        costs.append(total / len(sources))
    return torch.stack(costs)


def test_public_positions_reproduce_the_public_warp() -> None:
    cameras, features = cameras_of_several_lenses(3), random_features(3)
    batch = cameras.as_batch()
    depths = candidate_depths(batch)[:, None, None].expand(-1, 3, -1, -1)
    found = cost_volume(features, batch, source_views(batch), public_positions, depths)[0]
    expected = torch.stack(
        [publicly_warped_cost(features[0], cameras, view, [v for v in range(3) if v != view]) for view in range(3)]
    )
    assert expected.abs().max() > 1
    torch.testing.assert_close(found[:, CHECKED], expected, atol=2e-4, rtol=1e-4)


def test_exact_positions_are_where_the_source_camera_sees_the_point() -> None:
    cameras = cameras_of_several_lenses(2)
    depths = torch.tensor([2.0, 5.0])
    found = exact_positions(cameras, 0, 1, depths, HEIGHT, WIDTH)
    for candidate, depth in enumerate(depths):
        points = pixel_rays(cameras.select([0]), HEIGHT, WIDTH)[0].flatten(0, 1) * depth
        world = points @ cameras.extrinsics[0, :3, :3].T + cameras.extrinsics[0, :3, 3]
        seen = (world - cameras.extrinsics[1, :3, 3]) @ cameras.extrinsics[1, :3, :3]
        projected = seen @ cameras.intrinsics[1].T
        torch.testing.assert_close(found[:, candidate], projected[:, :2] / projected[:, 2:], atol=1e-5, rtol=1e-4)


def test_candidates_and_sources() -> None:
    inverse = 1 / candidate_depths(example_cameras(2, near=0.5, far=100.0).as_batch())[0]
    torch.testing.assert_close(inverse[[0, -1]], torch.tensor([0.01, 2.0]))
    torch.testing.assert_close(inverse.diff(), torch.full((127,), 1.99 / 127), atol=1e-6, rtol=0)
    cameras = example_cameras(5)
    cameras.extrinsics[:, :3, 3] = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2.1, 0, 0], [3.3, 0, 0], [10, 0, 0]])
    assert source_views(cameras.as_batch())[0].tolist() == [[1, 2], [0, 2], [1, 3], [2, 1], [3, 2]]
    assert source_views(cameras.select([0, 1, 2]).as_batch())[0].tolist() == [[1, 2], [0, 2], [0, 1]]
    assert source_views(cameras.select([0, 1]).as_batch())[0].tolist() == [[1], [0]]
    assert source_views(cameras.select([0]).as_batch())[0].tolist() == [[0]]
