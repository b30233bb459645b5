"""The public network's numbers; any number of views, any size, batches, half-resolution matching, number types."""

import numpy as np
import pytest
import torch
from public_network import SHAPES, SHIPPED, made_up_extractor, require_near, views_of

from fecocodec.errors import InputError, ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from tests.example_scenes import example_cameras, example_views, fused


@pytest.fixture(scope="module")
def extractor() -> DepthSplatSmall:
    return made_up_extractor()


def inputs(num_views: int, height: int = 64, width: int = 64, seed: int = 0) -> tuple[torch.Tensor, Cameras]:
    return example_views(num_views, height, width, seed).images[None], example_cameras(num_views, seed).as_batch()


@torch.inference_mode()
def test_tensors_and_numbers_of_every_branch_are_the_public_ones(extractor: DepthSplatSmall) -> None:
    assert {name: list(value.shape) for name, value in extractor.state_dict().items()} == SHAPES
    arrays = dict(np.load(SHIPPED))
    images, cameras = views_of(arrays)
    evidence = extractor.match(images, cameras)
    found = {
        "features_cnn": evidence.appearance,
        "features_mv": evidence.multi_view,
        "features_mono": evidence.monocular,
        "cost_volume": evidence.cost,
        "f1": extractor.fuse(images, evidence),
    }
    of_channels, step = int(arrays["channel_step"]), int(arrays["position_step"])
    for name, value in found.items():
        require_near(value[:, ::of_channels, ::step, ::step], arrays[name], name)


@pytest.mark.parametrize(("num_views", "size"), [(1, (64, 64)), (3, (64, 96)), (5, (96, 64))])
@torch.inference_mode()
def test_views_and_sizes(extractor: DepthSplatSmall, num_views: int, size: tuple[int, int]) -> None:
    features = fused(extractor, *inputs(num_views, *size))
    assert features.shape == (num_views, 128, size[0] // 4, size[1] // 4) and features.isfinite().all()


@torch.inference_mode()
def test_scenes_of_a_batch_do_not_mix(extractor: DepthSplatSmall) -> None:
    (images_a, cameras_a), (images_b, cameras_b) = inputs(2, seed=1), inputs(2, seed=2)
    joined = Cameras(*(torch.cat(pair) for pair in zip(cameras_a.fields(), cameras_b.fields(), strict=True)))
    together = fused(extractor, torch.cat((images_a, images_b)), joined)
    alone = torch.cat((fused(extractor, images_a, cameras_a), fused(extractor, images_b, cameras_b)))
    torch.testing.assert_close(together, alone, atol=1e-4, rtol=1e-4)


@torch.inference_mode()
def test_order_of_two_views_and_unit_of_length_change_nothing(extractor: DepthSplatSmall) -> None:
    images, cameras = inputs(2)
    turned = fused(extractor, images.flip(1), cameras.scene(0).select([1, 0]).as_batch())
    expected = fused(extractor, images, cameras)
    torch.testing.assert_close(turned.flip(0), expected, atol=1e-4, rtol=1e-4)
    extrinsics = cameras.extrinsics.clone()
    extrinsics[..., :3, 3] *= 50.0
    scaled = Cameras(extrinsics, cameras.intrinsics, 50.0 * cameras.near, 50.0 * cameras.far)
    assert (fused(extractor, images, scaled) - expected).norm() < 1e-3 * expected.norm()


@torch.inference_mode()
def test_matching_at_half_resolution_resembles_matching_at_full(extractor: DepthSplatSmall) -> None:
    images, cameras = inputs(2, 128, 128)
    extractors = extractor, made_up_extractor(matching_scale=2)
    full, half = (of.match(images, cameras).cost for of in extractors)
    assert full.shape == half.shape
    assert torch.corrcoef(torch.stack((full.flatten(), half.flatten())))[0, 1] > 0.5


@torch.inference_mode()
def test_both_geometries_are_there_and_differ(extractor: DepthSplatSmall) -> None:
    images, cameras = inputs(3)
    exact = fused(made_up_extractor(geometry="exact"), images, cameras)
    public = fused(extractor, images, cameras)
    assert exact.isfinite().all() and (exact - public).norm() > 0.01 * public.norm()


@torch.inference_mode()
def test_bfloat16_stays_within_its_stated_bound(extractor: DepthSplatSmall) -> None:
    """Stated in docs/paper_profile.md: 3% of F1's norm; the cost volume stays float32 at any rate.

    Small images, because a CPU without bfloat16 instructions takes minutes for larger ones.
    """
    images, cameras = inputs(2, 32, 32)
    expected = fused(extractor, images, cameras)
    with torch.autocast("cpu", torch.bfloat16):
        evidence = extractor.match(images, cameras)
        found = extractor.fuse(images, evidence)
    assert evidence.cost.dtype == torch.float32
    assert (found.float() - expected).norm() < 0.03 * expected.norm()


def test_every_parameter_learns() -> None:
    torch.manual_seed(0)
    extractor = made_up_extractor().requires_grad_(True)
    images, cameras = inputs(2)
    fused(extractor, images, cameras).square().mean().backward()
    silent = [name for name, p in extractor.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    assert silent == []


def test_refusals(extractor: DepthSplatSmall) -> None:
    with pytest.raises(InputError, match="images of 72x64 pixels: pad to multiples of 16"):
        fused(extractor, *inputs(2, 64, 72))
    with pytest.raises(ModelError, match="geometry 'wrong': there is none of that name; choose one of public, exact"):
        DepthSplatSmall(geometry="wrong")
