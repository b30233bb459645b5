"""Devices of networks."""

import pytest
import torch
from torch import nn

from fecocodec.errors import InputError
from fecocodec.layers.memory_format import to_channels_last


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


def test_weights_of_convolutions_have_channels_last() -> None:
    network = nn.Conv2d(4, 4, 3)
    to_channels_last(network, "cpu")
    assert network.weight.is_contiguous(memory_format=torch.channels_last)
