"""The Gaussian predictor is bounded for any state and independent of view order and unit of length."""

from contextlib import nullcontext
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from fecocodec.config import PAPER, ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.layers.blocks import direct_gradients
from fecocodec.receiver.model import Receiver
from fecocodec.splatting.emission import Emission, emit
from tests.example_scenes import example_cameras
from tests.rendering.brute_force import sh_basis


@pytest.fixture(scope="module")
def receiver() -> Receiver:
    torch.manual_seed(0)
    return Receiver(ReceiverConfig()).eval().requires_grad_(False)


def predict(receiver: Receiver, state: Tensor, cameras: Cameras) -> Gaussians:
    condition = receiver.condition(torch.full((len(state),), 600), 2)
    prediction = receiver.predict(state, cameras.as_batch(), condition)
    return emit(prediction, cameras.as_batch(), receiver.config, Emission(has_fitted_colours=False))


def state_of(num_views: int) -> Tensor:
    return torch.randn(num_views, 128, 16, 16, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("factor", [0.0, 1.0, 1e4, 1e12])
def test_gaussians_are_finite_and_bounded_for_any_state(receiver: Receiver, factor: float) -> None:
    cameras = example_cameras(2, near=0.5, far=50.0)
    gaussians = predict(receiver, state_of(2) * factor, cameras)
    assert all(bool(field.isfinite().all()) for field in gaussians.fields())
    torch.testing.assert_close(gaussians.rotations.norm(dim=-1), torch.ones(gaussians.count), atol=1e-5, rtol=0)
    assert float(gaussians.opacities.min()) >= 0.0 and float(gaussians.opacities.max()) <= 1.0
    assert float(gaussians.scales.min()) > 0.0
    depth = cameras.select([0]).project(gaussians.means[: gaussians.count // 2]).depth
    assert float(depth.min()) > 0.8 * 0.5 and float(depth.max()) < 1.01 * 2 * 50.0
    colours = 0.5 + 0.28209479 * gaussians.harmonics
    assert float(colours.min()) >= -1e-4 and float(colours.max()) <= 1.0001


def test_gaussians_project_near_the_cell_that_made_them(receiver: Receiver) -> None:
    cameras, size = example_cameras(2), 32
    means = predict(receiver, state_of(2), cameras).means.view(2, size, size, 3)
    position = size * torch.stack([cameras.select([view]).project(means[view]).uv[0] for view in range(2)])
    row, column = torch.meshgrid(torch.arange(size) + 0.5, torch.arange(size) + 0.5, indexing="ij")
    assert float((position[..., 0] - column).abs().max()) <= 1.001
    assert float((position[..., 1] - row).abs().max()) <= 1.001


def test_views_and_units_are_independent(receiver: Receiver) -> None:
    order, state, cameras = [2, 0, 1], state_of(3), example_cameras(3)
    gaussians = predict(receiver, state, cameras)
    permuted = predict(receiver, state[order], cameras.select(order))
    for field, other in zip(gaussians.fields(), permuted.fields(), strict=True):
        by_view = field.unflatten(0, (3, -1))[order].flatten(0, 1)
        torch.testing.assert_close(other, by_view, atol=1e-3, rtol=1e-3)
    cameras, unit = example_cameras(2), 64.0
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, :3, 3] *= unit
    scaled = replace(cameras, extrinsics=extrinsics, near=cameras.near * unit, far=cameras.far * unit)
    small, large = predict(receiver, state_of(2), cameras), predict(receiver, state_of(2), scaled)
    torch.testing.assert_close(large.means, small.means * unit, atol=1e-2, rtol=1e-4)
    torch.testing.assert_close(large.scales, small.scales * unit, atol=0, rtol=1e-4)
    torch.testing.assert_close(large.opacities, small.opacities, atol=1e-4, rtol=0)
    torch.testing.assert_close(large.harmonics, small.harmonics, atol=1e-4, rtol=0)


def test_predicted_harmonics_are_in_the_frame_of_their_camera() -> None:
    """Constant outputs of the head give the colours, and their gradient, of section 9.1 of FORMAT.md."""
    receiver = Receiver(ReceiverConfig(method=PAPER, sh_degree=2, gaussians_per_side=1))
    last, cameras = receiver.predictor.head[2], example_cameras(2)
    nn.init.zeros_(last.weight)
    nn.init.normal_(last.bias, generator=torch.Generator().manual_seed(1))
    direction = F.normalize(torch.tensor([0.3, -0.5, 0.7]), dim=0)
    harmonics = predict(receiver, state_of(2), cameras).harmonics
    found = torch.einsum("k,nkc->nc", sh_basis(direction)[:9], harmonics).unflatten(0, (2, -1))
    base, higher = torch.sigmoid(2.0 * last.bias[11:14]) - 0.5, last.bias[14:].view(8, 3)
    shares = torch.tensor([0.1 * 0.25**degree for degree in (1, 1, 1, 2, 2, 2, 2, 2)])
    for view, colours in enumerate(found):
        basis = sh_basis(cameras.extrinsics[view, :3, :3].T @ direction)[1:9]
        expected = base + (shares * basis) @ higher
        torch.testing.assert_close(colours, expected.expand_as(colours), atol=1e-6, rtol=0)
        gradients = (torch.autograd.grad(x[..., 0].mean(), last.bias, retain_graph=True) for x in (colours, expected))
        torch.testing.assert_close(*gradients, atol=1e-6, rtol=0)


def test_direct_gradients_are_part_of_all_and_change_no_value(receiver: Receiver) -> None:
    cameras = example_cameras(2)
    found = []
    for context in (nullcontext, direct_gradients):
        leaf = state_of(2).requires_grad_()
        with context():
            colours = predict(receiver, leaf, cameras).harmonics
        (gradient,) = torch.autograd.grad(colours.square().sum(), leaf)
        found.append((colours.detach(), gradient))
    (of_all, whole), (of_direct, part) = found
    torch.testing.assert_close(of_direct, of_all, atol=0.0, rtol=0.0)
    assert 0.0 < float((whole - part).norm()) < float(whole.norm())
