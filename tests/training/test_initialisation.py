"""Before the first step, the networks already carry colours and disparity from photographs to Gaussians."""

import pytest
import torch
import torch.nn.functional as F

from fecocodec.config import COMPACT, PAPER, ReceiverConfig, SenderConfig
from fecocodec.geometry.gaussians import SH_DEGREE_0
from fecocodec.receiver.model import Receiver
from fecocodec.sender.extractors.compact import MatchedMaps, SweptMatching
from fecocodec.sender.model import Sender
from fecocodec.training.initialisation import (
    CELL_CHANNELS,
    COLOURS,
    PIXELS,
    forward_transform,
    inverse_transform,
    start_as_block_transform,
)
from tests.example_scenes import example_views

LAMBDA_Q = torch.tensor([281])


def started(config: ReceiverConfig) -> tuple[Sender, Receiver]:
    torch.manual_seed(0)
    receiver = Receiver(config).eval()
    sender = Sender(SenderConfig(), config).eval()
    start_as_block_transform(sender, receiver)
    return sender, receiver


@pytest.fixture(scope="module")
def networks() -> tuple[Sender, Receiver]:
    return started(ReceiverConfig())


def smooth_picture() -> torch.Tensor:
    """[1 3 64 64] in [-1, 1], of low frequencies only."""
    coarse = torch.rand(1, 3, 5, 5, generator=torch.Generator().manual_seed(1)) * 1.6 - 0.8
    return F.interpolate(coarse, size=(64, 64), mode="bicubic", align_corners=False).clamp(-1, 1)


def test_inverse_of_forward_gives_half_resolution_colours_and_disparity() -> None:
    picture = smooth_picture()
    disparity = F.avg_pool2d(picture[:, :1], 4)
    cells = torch.cat((F.pixel_unshuffle(picture, 4), disparity), dim=1)
    coefficients = F.conv2d(cells, forward_transform(), stride=2)
    decoded = torch.einsum("cpk,nkhw->ncphw", inverse_transform(), coefficients)
    decoded = F.pixel_shuffle(decoded.flatten(1, 2), 2)  # [1 13 16 16]
    assert torch.allclose(decoded[:, COLOURS:], disparity, atol=1e-5)
    colours = F.pixel_shuffle(decoded[:, :COLOURS], 2)
    assert (colours - F.avg_pool2d(picture, 2)).abs().mean() < 0.02


@pytest.mark.parametrize(("method", "per_side"), [(COMPACT, 2), (PAPER, 1), (PAPER, 4)])
def test_gaussians_have_the_photographs_colours(method: str, per_side: int) -> None:
    config = ReceiverConfig(method=method, gaussians_per_side=per_side)
    assert colour_error(*started(config), side=16 * per_side) < 0.04


@torch.no_grad()
def colour_error(sender: Sender, receiver: Receiver, side: int) -> float:
    """Mean difference of the colours of side x side Gaussians from those of the picture, of half its resolution."""
    views = example_views(num_views=1)
    picture = (smooth_picture() + 1) / 2
    cells = torch.zeros(1, receiver.config.state_channels, 16, 16)
    cells[:, : CELL_CHANNELS - 1] = F.pixel_unshuffle(2 * picture - 1, 4)
    condition = receiver.condition(LAMBDA_Q, 1)
    state = receiver.update.start(1, 16, 16)
    y_hat = sender.analysis(cells, state, condition).round()
    prediction = receiver.predict(receiver.next_state(state, y_hat, condition), views.cameras.as_batch(), condition)
    harmonics = prediction.attributes.gaussians().scene(0).harmonics.view(1, side, side, 3).permute(0, 3, 1, 2)
    expected = F.interpolate(F.avg_pool2d(picture, 2), size=(side, side), mode="area")
    return float((0.5 + SH_DEGREE_0 * harmonics - expected).abs().mean())


@torch.no_grad()
def test_the_papers_feedback_begins_with_the_errors_of_the_rendering() -> None:
    sender, receiver = started(ReceiverConfig(method=PAPER, gaussians_per_side=2))
    images, renderings = torch.rand(2, 1, 3, 32, 32, generator=torch.Generator().manual_seed(2))
    features = sender.feedback(images, renderings, torch.zeros(1, 2, 8, 8), receiver.condition(LAMBDA_Q, 2))
    torch.testing.assert_close(features[:, :PIXELS], 2 * F.pixel_unshuffle(images - renderings, 4))


@torch.no_grad()
def test_matched_disparity_reaches_the_predictor(networks: tuple[Sender, Receiver]) -> None:
    sender, receiver = networks
    views = example_views(num_views=1)
    stem, candidates = sender.config.stem_channels, sender.config.num_candidates
    relative = F.avg_pool2d(smooth_picture()[:, :1], 4) / 2 + 0.5
    nothing = torch.zeros(1, 1, 16, 16)
    matching = SweptMatching(
        relative_disparity=nothing,
        depth=MatchedMaps(relative, nothing, nothing, relative),
        appearance=torch.zeros(1, 2 * stem, 16, 16),
        cost=torch.zeros(1, candidates, 16, 16),
    )
    features = sender.extractor.fuse(views.images[None], matching)
    condition = receiver.condition(LAMBDA_Q, 1)
    state = receiver.update.start(1, 16, 16)
    state = receiver.next_state(state, sender.analysis(features, state, condition), condition)
    prediction = receiver.predict(state, views.cameras.as_batch(), condition)
    assert (prediction.relative_disparity[0, 0] - relative[0, 0]).abs().mean() < 0.05
