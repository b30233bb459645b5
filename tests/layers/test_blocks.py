"""Blocks shared by the networks."""

import pytest
import torch
from torch import nn

from fecocodec.layers.blocks import (
    CONDITION_CHANNELS,
    AdaptiveNorm,
    BlockChain,
    ChannelNorm,
    PlainBlock2d,
    RateCondition,
    RateEmbedding,
    downsample,
    upsample,
)
from fecocodec.layers.memory_format import to_channels_last


def test_channel_norm_gives_every_position_mean_zero_and_variance_one() -> None:
    normed = ChannelNorm()(torch.randn(2, 64, 5, 7) * 30 + 4)
    torch.testing.assert_close(normed.mean(dim=1), torch.zeros(2, 5, 7), atol=1e-5, rtol=0)
    torch.testing.assert_close(normed.var(dim=1, unbiased=False), torch.ones(2, 5, 7), atol=1e-3, rtol=0)


def test_adaptive_norm_scales_and_shifts_by_the_condition_of_each_item() -> None:
    norm = AdaptiveNorm(8)
    nn.init.normal_(norm.modulation.weight)
    x, condition = torch.randn(2, 8, 3, 4), _any_condition(2)
    gamma, beta = norm.modulation(condition.embedding).chunk(2, dim=1)
    expected = torch.stack(
        [ChannelNorm()(x)[i] * (1 + gamma[i, :, None, None]) + beta[i, :, None, None] for i in (0, 1)]
    )
    torch.testing.assert_close(norm(x, condition), expected)


def test_the_condition_tells_lambdas_and_stages_apart() -> None:
    torch.manual_seed(0)
    embedding = RateEmbedding(1768, 11.0, 0.5)
    lambda_q = torch.tensor([0, 884, 1768])
    first, second = embedding(lambda_q, 1), embedding(lambda_q, 2)
    assert first.embedding.shape == (3, CONDITION_CHANNELS)
    conditions = torch.cat((first.embedding, second.embedding))
    distances = torch.cdist(conditions, conditions) + torch.eye(6) * 1e9
    assert float(distances.detach().min()) > 1e-3


def test_a_higher_price_makes_the_step_between_latents_coarser() -> None:
    gains = RateEmbedding(1768, 11.0, 0.5)(torch.tensor([0, 281, 884, 1768]), 1).latent_gain.flatten()
    assert bool((gains.diff() < 0).all())
    assert float(gains[0]) == pytest.approx(11.0)  # lambda 1e-5
    assert float(gains[0] / gains[3]) == pytest.approx(1000**0.5, rel=0.01)


def _any_condition(num_items: int) -> RateCondition:
    return RateCondition(torch.randn(num_items, CONDITION_CHANNELS), torch.ones(num_items, 1, 1, 1))


def test_sampling_and_blocks_keep_their_promised_shapes() -> None:
    x = torch.randn(3, 16, 8, 12)
    assert downsample(16, 24)(x).shape == (3, 24, 4, 6)
    assert upsample(16, 8)(x).shape == (3, 8, 16, 24)
    assert PlainBlock2d(16, 10)(x).shape == x.shape
    assert BlockChain(16, 10, 2)(x, _any_condition(3)).shape == x.shape


def test_placing_a_network_changes_its_memory_and_not_its_values() -> None:
    torch.manual_seed(0)
    network, x = nn.Sequential(nn.Conv2d(4, 6, 3), nn.ReLU(), nn.Conv2d(6, 2, 1)), torch.randn(1, 4, 9, 9)
    before = network(x)
    to_channels_last(network, "cpu")
    assert network[0].weight.is_contiguous(memory_format=torch.channels_last)
    torch.testing.assert_close(network(x), before)
