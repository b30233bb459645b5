"""Blocks shared by the networks."""

import pytest
import torch
import torch.nn.functional as F
from torch import nn

from fecocodec.errors import InputError
from fecocodec.layers.blocks import (
    CONDITION_CHANNELS,
    AdaptiveNorm,
    Block2d,
    ChannelNorm,
    RateCondition,
    RateEmbedding,
    direct_gradients,
    pixel_shuffle,
    pointwise,
)
from fecocodec.layers.memory_format import to_channels_last


@pytest.mark.parametrize(
    ("channels", "outputs", "size"), [(256, 128, (48, 64)), (264, 704, (12, 16)), (128, 384, (9, 7))]
)
def test_pointwise_is_a_convolution_whose_bits_do_not_depend_on_threads(
    channels: int, outputs: int, size: tuple[int, int]
) -> None:
    x = torch.randn(2, channels, *size).contiguous(memory_format=torch.channels_last)
    weight, bias = 0.05 * torch.randn(outputs, channels, 1, 1), torch.randn(outputs)
    before, results = torch.get_num_threads(), []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            results.append(pointwise(x, weight, bias))
    finally:
        torch.set_num_threads(before)
    assert torch.equal(*results)
    torch.testing.assert_close(results[0], F.conv2d(x, weight, bias), atol=1e-4, rtol=1e-4)


def test_adaptive_norm_scales_each_channel_by_the_condition_of_its_item() -> None:
    norm = AdaptiveNorm(8)
    nn.init.normal_(norm.modulation.weight)
    x, condition = torch.randn(2, 8, 3, 4), _any_condition(2)
    changed = RateCondition(condition.embedding * torch.tensor([[1.0], [0.0]]), condition.latent_gain)
    before, after = norm(x, condition).detach(), norm(x, changed).detach()
    torch.testing.assert_close(after[0], before[0])
    torch.testing.assert_close(after[1], ChannelNorm()(x)[1])  # a condition of zero leaves the normalised values
    norm = AdaptiveNorm(8)
    nn.init.normal_(norm.modulation.weight)
    x, condition = torch.randn(1, 8, 6, 6), _any_condition(1)
    normed, modulated = ChannelNorm()(x)[0].flatten(1), norm(x, condition)[0].detach().flatten(1)
    for channel in range(8):
        correlation = torch.corrcoef(torch.stack((normed[channel], modulated[channel])))[0, 1]
        assert abs(float(correlation)) == pytest.approx(1.0, abs=1e-4)
    assert float((modulated - normed).abs().mean()) > 0.1


def test_conditions_and_steps_of_lambdas() -> None:
    torch.manual_seed(0)
    embedding = RateEmbedding(1768, 11.0, 0.5)
    lambda_q = torch.tensor([0, 884, 1768])
    first, second = embedding(lambda_q, 1), embedding(lambda_q, 2)
    assert first.embedding.shape == (3, CONDITION_CHANNELS)
    conditions = torch.cat((first.embedding, second.embedding))
    distances = torch.cdist(conditions, conditions) + torch.eye(6) * 1e9
    assert float(distances.detach().min()) > 1e-3
    gains = RateEmbedding(1768, 11.0, 0.5)(torch.tensor([0, 281, 884, 1768]), 1).latent_gain.flatten()
    assert bool((gains.diff() < 0).all())
    assert float(gains[0]) == pytest.approx(11.0)  # lambda 1e-5
    assert float(gains[0] / gains[3]) == pytest.approx(1000**0.5, rel=0.01)


def _any_condition(num_items: int) -> RateCondition:
    return RateCondition(torch.randn(num_items, CONDITION_CHANNELS), torch.ones(num_items, 1, 1, 1))


def test_channels_last_changes_memory_and_not_values() -> None:
    x = torch.randn(2, 12, 3, 5).contiguous(memory_format=torch.channels_last)
    shuffled = pixel_shuffle(x)
    assert torch.equal(shuffled, nn.functional.pixel_shuffle(x, 2))
    assert shuffled.is_contiguous(memory_format=torch.channels_last)
    torch.manual_seed(0)
    network, x = nn.Sequential(nn.Conv2d(4, 6, 3), nn.ReLU(), nn.Conv2d(6, 2, 1)), torch.randn(1, 4, 9, 9)
    before = network(x)
    to_channels_last(network, "cpu")
    assert network[0].weight.is_contiguous(memory_format=torch.channels_last)
    torch.testing.assert_close(network(x), before)


def test_a_residual_branch_receives_no_direct_gradient_and_keeps_its_values() -> None:
    torch.manual_seed(0)
    block, condition = Block2d(8, 16, is_residual_branch=True), _any_condition(1)
    x = torch.randn(1, 8, 6, 6, requires_grad=True)
    whole = block(x, condition)
    (full_gradient,) = torch.autograd.grad(whole.sum(), x)
    with direct_gradients():
        direct = block(x, condition)
    (direct_gradient,) = torch.autograd.grad(direct.sum(), x)
    assert torch.equal(direct, whole)
    assert torch.equal(direct_gradient, torch.ones_like(x))
    assert float((full_gradient - direct_gradient).abs().max()) > 1e-3


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("gpu", "there is no device 'gpu'"),
        ("cpu:x", "there is no device"),
        ("cuda:99", "torch sees [0-9]+ CUDA devices"),
    ],
)
def test_a_device_that_is_not_there_is_refused(device: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        to_channels_last(nn.Conv2d(2, 2, 3), device)
