"""One thread and two give equal bytes and equal Gaussians."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode
from fecocodec.sender.encode import encode
from tests.example_scenes import MODEL, example_views


@contextmanager
def threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def coded_with(count: int, model: Path, num_views: int) -> tuple[bytes, Gaussians]:
    with threads(count):
        data = encode(example_views(num_views), lmbda=1e-4, model=model)
        return data, decode(data, model=model).gaussians


@pytest.mark.parametrize("num_views", [2, 5])
def test_the_number_of_threads_changes_no_bit(random_weights: Path, num_views: int) -> None:
    data, gaussians = coded_with(1, random_weights / MODEL, num_views)
    data_of_two, gaussians_of_two = coded_with(2, random_weights / MODEL, num_views)
    assert data_of_two == data
    for one, two in zip(gaussians.fields(), gaussians_of_two.fields(), strict=True):
        assert torch.equal(one, two)
