"""Descent on the detail layer shows the photographs better, and sends nothing where bits cost too much."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import encode, measure_decoded, read_views
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.detail_steps import Search, descend, symbols_of
from fecocodec.sender.lambda_roles import price_of_detail
from fecocodec.sender.optimisation_config import BEST, DEFAULT, FAST
from fecocodec.sender.references import References
from tests.example_scenes import cameras_in_a_row, synthetic_views

EXAMPLE = Path(__file__).parents[2] / "examples" / "motorcycle"
DETAIL = DEFAULT.with_steps(1)  # few steps of the latents, which are not what is tested
WITHOUT = replace(DETAIL, detail_steps=0)


@pytest.fixture(scope="module")
def views() -> Views:
    return read_views(EXAMPLE, size=(64, 96))


@pytest.fixture(scope="module")
def with_detail(views: Views) -> bytes:
    return encode(views, lmbda=1e-4, effort=DETAIL)


class Shown(References):
    """Photographs that are compared with 0.1 * red, green and blue of each Gaussian, as if these were pixels."""

    def rendered(self, gaussians: Gaussians) -> torch.Tensor:
        return 0.1 * gaussians.means.reshape(len(self.images), 8, 8, 3).permute(0, 3, 1, 2)


def search_of(images: torch.Tensor, price: float = 0.0) -> Search:
    """Pictures that depend on the numbers as if every plane were a colour."""
    cameras = cameras_in_a_row(*[0.0] * len(images))

    def gaussians(values: torch.Tensor) -> Gaussians:
        means = values.permute(0, 2, 3, 1).reshape(-1, 3)
        ones = torch.ones(len(means))
        return Gaussians(means, means, torch.ones(len(means), 4), ones, torch.zeros(len(means), 1, 3))

    return Search(Shown(cameras, images, None, len(images)), gaussians, gaussians, price)


def test_steps_approach_the_photographs_as_far_as_bits_are_worth_it() -> None:
    images = torch.rand(2, 3, 8, 8, generator=torch.Generator().manual_seed(0))
    errors = [
        float((0.1 * descend(search_of(images), torch.zeros(2, 3, 8, 8), steps) - images).square().mean())
        for steps in (1, 5, 30)
    ]
    assert errors[0] < float(images.square().mean())
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 0.05 * float(images.square().mean())
    assert not descend(search_of(images, price=10.0), torch.zeros(2, 3, 8, 8), 5).any()
    found = descend(search_of(torch.zeros(1, 3, 8, 8)), torch.zeros(1, 3, 8, 8), 3)
    assert torch.equal(found, torch.zeros(1, 3, 8, 8))
    values = torch.zeros(1, 1, 1, 3)
    values[0, 0, 0] = torch.tensor([0.55, 1.4, -2.9])
    table = torch.full((1, 1, 3), 22, dtype=torch.uint8).numpy()  # standard deviation 1
    assert symbols_of(values)(0, table).tolist() == [[[0, 1, -3]]]


def test_detail_raises_the_quality_more_at_smaller_lambdas(views: Views, with_detail: bytes) -> None:
    without = encode(views, lmbda=1e-4, effort=WITHOUT)
    assert read_stream(with_detail).detail is not None
    assert read_stream(without).detail is None
    better, plain = (measure_decoded(data, views)[-1].psnr for data in (with_detail, without))
    assert better > plain + 0.5
    assert len(with_detail) < 1.5 * len(without)
    sizes = []
    for data in (encode(views, lmbda=1e-3, effort=DETAIL), with_detail, encode(views, lmbda=1e-5, effort=DETAIL)):
        detail = read_stream(data).detail
        sizes.append(0 if detail is None else len(detail.payload))
    assert sizes[0] == 0
    assert sizes == sorted(set(sizes))


def test_many_views_have_detail_at_every_lambda() -> None:
    lambda_q = quantise_lambda(1e-3)
    assert DEFAULT.detail_steps_of(3, 2**17, lambda_q) == 0 < DEFAULT.detail_steps_of(4, 2**17, lambda_q)
    assert price_of_detail(3, 0, lambda_q) > price_of_detail(4, 0, lambda_q)
    four = synthetic_views(4, 0, seed=3)
    with_detail = encode(four, lmbda=1e-3, effort=DETAIL)
    assert read_stream(with_detail).detail is not None
    without = encode(four, lmbda=1e-3, effort=WITHOUT)
    better, plain = (measure_decoded(data, four)[-1].psnr for data in (with_detail, without))
    assert better > plain + 0.1


def test_effort_fast_and_too_large_scenes_get_no_detail(views: Views) -> None:
    assert read_stream(encode(views, effort="fast")).detail is None
    lambda_q = quantise_lambda(1e-4)
    assert DEFAULT.detail_steps_of(2, 2**17, quantise_lambda(1e-3)) == 0
    assert FAST.detail_steps_of(2, 2**17, lambda_q) == 0
    assert DEFAULT.detail_steps_of(2, 2**22 + 1, lambda_q) == 0
    assert 0 < DEFAULT.detail_steps_of(2, 2**22, lambda_q) < DEFAULT.detail_steps_of(2, 2**17, lambda_q)
    assert BEST.detail_steps_of(2, 2**17, lambda_q) > DEFAULT.detail_steps_of(2, 2**17, lambda_q)
