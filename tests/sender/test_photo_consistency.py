"""Photo-consistency at candidate depths: against a straightforward warp, and on a wall at a known distance."""

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, depth_from_relative_disparity, pixel_rays
from fecocodec.sender.extractors.photo_consistency import LEAST_VARIANCE, RADIUS, photo_consistency
from fecocodec.sender.extractors.plane_sweep import source_views
from tests.example_scenes import cameras_in_a_row, example_cameras, example_views

CANDIDATES = 16


def windows(x: Tensor) -> Tensor:
    return F.avg_pool2d(x, 2 * RADIUS + 1, stride=1)  # whole windows only


def warped_consistency(images: Tensor, cameras: Cameras, view: int, source: int) -> Tensor:
    """[candidate h w] at half size, without the border: warp a whole image at every candidate, then correlate."""
    half = F.avg_pool2d(images, 2)
    height, width = half.shape[-2:]
    own, own_mean = half[view][None], windows(half[view][None])
    own_variance = (windows(own * own) - own_mean.square()).sum(dim=1)
    to_source = cameras.world_to_camera[source] @ cameras.extrinsics[view]
    scores = []
    for relative in torch.linspace(0, 1, CANDIDATES):
        depth = depth_from_relative_disparity(relative.expand(1, 1, 1), cameras)
        points = pixel_rays(cameras, height, width)[view] * depth @ to_source[:3, :3].T + to_source[:3, 3]
        projected = points @ cameras.intrinsics[source].T
        uv = torch.where(points[..., 2:] > 1e-6, projected[..., :2] / points[..., 2:], torch.tensor(9.0))
        warped = F.grid_sample(half[source][None], 2 * uv[None] - 1, padding_mode="border", align_corners=False)
        mean = windows(warped)
        variance = (windows(warped * warped) - mean.square()).sum(dim=1)
        covariance = (windows(own * warped) - own_mean * mean).sum(dim=1)
        score = covariance / ((own_variance + float(LEAST_VARIANCE)) * (variance + LEAST_VARIANCE)).sqrt()
        is_seen = ((uv >= 0) & (uv <= 1)).all(dim=-1)[RADIUS:-RADIUS, RADIUS:-RADIUS]
        scores.append(torch.where(is_seen, score[0], 0.0))
    return torch.stack(scores)


def wall(distance: float, offsets: tuple[float, ...], gain: float = 1.0) -> tuple[Tensor, Cameras]:
    """Views of a wall with a pattern, from cameras side by side (offsets along x); the second darker by `gain`."""
    cameras = cameras_in_a_row(*offsets, far=10.0)
    position = pixel_rays(cameras, 128, 128)[..., :2] * distance + cameras.extrinsics[:, None, None, :2, 3]
    waves = torch.randn(24, 2, generator=torch.Generator().manual_seed(0)) * 18.0 / distance
    phases = position @ waves.T
    images = torch.stack([phases[..., k::3].sin().sum(dim=-1) * 0.1 + 0.5 for k in range(3)], dim=1)
    return torch.stack([images[0], *(gain * image for image in images[1:])]).clamp(0, 1), cameras


def test_it_equals_warping_and_correlating() -> None:
    views = example_views(2, height=48, width=64)
    sources = torch.tensor([[[1], [0]]])
    found = photo_consistency(views.images[None], views.cameras.as_batch(), sources, CANDIDATES)
    for view in (0, 1):
        expected = warped_consistency(views.images, views.cameras, view, 1 - view)
        whole = F.avg_pool2d(expected[:, :, :], 2)  # the border is two pixels wide, one at 1/4
        assert float(whole.abs().max()) > 0.2
        torch.testing.assert_close(found[0, view, :, 1:-1, 1:-1], whole, atol=5e-3, rtol=0)


@pytest.mark.parametrize("gain", [1.0, 0.6])
def test_it_finds_the_distance_of_a_wall_whatever_the_exposure(gain: float) -> None:
    images, cameras = wall(2.5, (0.0, 0.4), gain)
    volume = photo_consistency(images[None], cameras.as_batch(), torch.tensor([[[1], [0]]]), CANDIDATES)[0]
    relative = (1 / 2.5 - 1 / 10) / (1 - 1 / 10)
    nearest = round(relative * (CANDIDATES - 1))
    middle = volume[:, :, 8:-8, 8:-8]
    is_right = (middle.argmax(dim=1) - nearest).abs() <= 1
    assert is_right.float().mean() > 0.95
    assert middle.amax(dim=1).median() > 0.9


def test_several_sources_are_averaged() -> None:
    images, cameras = wall(2.5, (0.0, 0.4, -0.3))
    both = photo_consistency(images[None], cameras.as_batch(), torch.tensor([[[1, 2], [0, 2], [0, 1]]]), CANDIDATES)
    each = [
        photo_consistency(images[None], cameras.as_batch(), torch.tensor([[[source], [0], [0]]]), CANDIDATES)[0, 0]
        for source in (1, 2)
    ]
    torch.testing.assert_close(both[0, 0], (each[0] + each[1]) / 2)


def test_views_that_show_nothing_of_each_other_agree_with_nothing() -> None:
    views = example_views(2)
    views.cameras.extrinsics[1, :3, :3] = views.cameras.extrinsics[0, :3, :3] @ torch.diag(torch.tensor([-1.0, 1, -1]))
    found = photo_consistency(views.images[None], views.cameras.as_batch(), torch.tensor([[[1], [0]]]), CANDIDATES)
    assert float(found.abs().max()) == 0.0
    cameras = example_cameras(1).as_batch()
    found = photo_consistency(torch.rand(1, 1, 3, 64, 32), cameras, source_views(cameras, 2), CANDIDATES)
    assert found.shape == (1, 1, CANDIDATES, 16, 8)
    assert float(found.abs().max()) == 0.0
