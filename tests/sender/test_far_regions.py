"""Plain regions that other views see through lie far away, behind the cameras on the other side."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from fecocodec.container import read_stream
from fecocodec.geometry.cameras import Cameras, relative_disparity_from_depth
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.views import Views
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.extractors.compact import CompactExtractor, MatchedMaps, SweptMatching
from fecocodec.sender.extractors.protocol import MatchedDepth, Matching
from fecocodec.sender.far_regions import BEYOND, far_factor, seen_through, with_far_regions
from fecocodec.sender.optimisation_config import FAST
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder

SIDE, RADIUS, NEAR, FAR, LAMBDA_Q = 96, 3.0, 1.8, 4.2, 1179
WHITE = (1.0, 1.0, 1.0)


def ring(count: int, share: float = 1.0) -> Cameras:
    """Return cameras around the origin, which they look at, on this share of a circle."""
    angle = torch.arange(count) / count * share * 2 * torch.pi
    forward = torch.stack((-angle.sin(), torch.zeros(count), -angle.cos()), dim=1)
    down = torch.tensor([0.0, 1.0, 0.0]).expand(count, 3)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = torch.stack((torch.linalg.cross(down, forward), down, forward), dim=2)
    poses[:, :3, 3] = -RADIUS * forward
    intrinsics = torch.tensor([[1.4, 0.0, 0.5], [0.0, 1.4, 0.5], [0.0, 0.0, 1.0]]).repeat(count, 1, 1)
    return Cameras(poses, intrinsics, torch.tensor(NEAR), torch.tensor(FAR))


def photographs(cameras: Cameras) -> Views:
    """Return photographs of a spotted ball before a white backdrop."""
    drawn = torch.Generator().manual_seed(0)
    points = torch.nn.functional.normalize(torch.randn(4000, 3, generator=drawn), dim=1) * 0.6
    harmonics = (torch.rand(4000, 1, 3, generator=drawn).round() * 0.8 - 0.5) / SH_DEGREE_0
    rotations = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(4000, 4)
    ball = Gaussians(points, torch.full((4000, 3), 0.03), rotations, torch.full((4000,), 0.95), harmonics)
    images = render(ball, cameras, (SIDE, SIDE), WHITE).color.clamp(0, 1)
    return Views(images, cameras, tuple(f"{number}.png" for number in range(len(images))))


def encoder_of(codec: Codec, cameras: Cameras) -> SceneEncoder:
    """Return an encoder whose matching puts the backdrop where the ball is, as it does with plain regions."""
    scene = prepare_scene(photographs(cameras), codec.device)
    encoder = SceneEncoder.of(codec, scene)
    disparity = disparity_of_the_ball(encoder.cameras)
    encoder.matching = Matching(disparity, MatchedDepth(disparity, torch.ones_like(disparity)))
    return encoder


def disparity_of_the_ball(cameras: Cameras) -> torch.Tensor:
    """Return a plane through the middle of the ball in each view: [view 1 h4 w4]. cameras: normalised, a batch."""
    depth = torch.full((1, cameras.num_views, SIDE // 4, SIDE // 4), RADIUS / NEAR)
    return relative_disparity_from_depth(depth, cameras)[0, :, None]


def test_the_backdrop_of_a_ball_is_far_and_the_ball_stays(codec: Codec) -> None:
    encoder = encoder_of(codec, ring(10))
    moved = with_far_regions(encoder).matching.depth.relative_disparity[:, 0]
    assert float((moved[:, :2] == 0.0).float().mean()) > 0.95
    ball = slice(10, 14)
    assert torch.equal(moved[:, ball, ball], encoder.matching.depth.relative_disparity[:, 0, ball, ball])


def test_far_is_behind_the_cameras_on_the_other_side() -> None:
    tight, wide = ring(10), replace(ring(10), far=torch.tensor(30.0))
    assert far_factor(tight) == pytest.approx(BEYOND * 2 * RADIUS / FAR, rel=1e-3)
    assert far_factor(wide) == far_factor(ring(10, share=0.02)) == 1.0


@pytest.mark.parametrize("cameras", [ring(4), ring(10, share=0.02)], ids=["few views", "views from one side"])
def test_nothing_moves_where_no_view_sees_through(codec: Codec, cameras: Cameras) -> None:
    assert not bool(seen_through(encoder_of(codec, cameras)).any())


def test_masked_pixels_stay(codec: Codec) -> None:
    encoder = encoder_of(codec, ring(10))
    encoder.ignored = torch.ones(10, SIDE, SIDE, dtype=torch.bool)
    assert not bool(seen_through(encoder).any())


def test_a_file_has_the_far_bound_where_a_view_sees_through(codec: Codec, monkeypatch: pytest.MonkeyPatch) -> None:
    views, real_match = photographs(ring(10)), CompactExtractor.match

    def match(extractor: CompactExtractor, images: torch.Tensor, cameras: Cameras, *others: Any) -> SweptMatching:
        disparity = disparity_of_the_ball(cameras)
        maps = MatchedMaps(disparity, torch.ones_like(disparity), torch.ones_like(disparity), disparity)
        return replace(real_match(extractor, images, cameras, *others), depth=maps)

    assert far_of(encode_with(codec, views, LAMBDA_Q, config=FAST)) == pytest.approx(FAR)
    monkeypatch.setattr(CompactExtractor, "match", match)
    assert far_of(encode_with(codec, views, LAMBDA_Q, config=FAST)) == pytest.approx(BEYOND * 2 * RADIUS, rel=1e-3)


def far_of(data: bytes) -> float:
    return read_stream(data).cameras.far
