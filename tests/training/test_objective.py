"""What a bit costs in training: lambda for the latents, one price for the entropy model."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from fecocodec.coding.symbol_choice import PRICES
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.sender.extractors.protocol import MatchedDepth
from fecocodec.sender.model import Sender
from fecocodec.sender.stages import EstimatedLatent, StageInputs
from fecocodec.training.batch import Batch, MatchedDisparity
from fecocodec.training.loss import ENTROPY_PRICE, lambda_of, loss_of, perceptual_distance
from fecocodec.training.training_pass import bypass_coding, code_with_noise, run_stages, with_targets
from tests.training.tiny_runs import synthetic_batch


@pytest.fixture(scope="module")
def networks() -> nn.ModuleDict:
    torch.manual_seed(0)
    config = ReceiverConfig()
    return nn.ModuleDict({"receiver": Receiver(config), "sender": Sender(SenderConfig(), config)})


@pytest.fixture(scope="module")
def latent() -> torch.Tensor:
    return 3.0 * torch.randn(2, 32, 8, 8, generator=torch.Generator().manual_seed(1))


def inputs(lambda_q: torch.Tensor, stage: int, y_hat: torch.Tensor | None) -> StageInputs:
    """What coding needs of a stage."""
    condition = RateCondition(torch.zeros(2, 64), torch.ones(2, 1, 1, 1))
    return StageInputs(stage, stage == 2, lambda_q, condition, torch.zeros(2, 128, 1, 1), y_hat)


@pytest.mark.parametrize(("price", "most_off"), [(0.0, 0.5), (0.2, 1.5)])
def test_latents_pass_through_with_the_gradient_of_what_they_were(
    networks: nn.ModuleDict, latent: torch.Tensor, price: float, most_off: float, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(PRICES, 1, (price, price))
    y = latent.clone().requires_grad_()
    code = code_with_noise(networks["receiver"], networks["sender"])
    y_hat = code(y, inputs(torch.tensor([100, 1700]), 1, None)).y_hat
    assert 0.0 < float((y_hat - y).detach().abs().max()) <= most_off + 1e-3
    y_hat.sum().backward()
    assert torch.equal(y.grad, torch.ones_like(y))


def test_a_bit_costs_a_latent_lambda_and_the_entropy_model_one_price(
    networks: nn.ModuleDict, latent: torch.Tensor, monkeypatch: pytest.MonkeyPatch
):
    lambda_q = torch.tensor([100, 1700])
    slopes, entropy_slopes = [], []
    for price in (ENTROPY_PRICE, 10 * ENTROPY_PRICE):
        monkeypatch.setattr("fecocodec.training.training_pass.ENTROPY_PRICE", price)
        networks.zero_grad()
        y, context = latent.clone().requires_grad_(), latent.clone().requires_grad_()
        torch.manual_seed(2)
        bits = code_with_noise(networks["receiver"], networks["sender"])(y, inputs(lambda_q, 2, context)).bits
        (price * bits).sum().backward()
        slopes.append((y.grad, context.grad))
        entropy_slopes.append(networks["receiver"].prior.enter.weight.grad.clone())
    for first, second in zip(*slopes, strict=True):
        torch.testing.assert_close(first, second, rtol=1e-3, atol=1e-7)  # lambda's alone, whatever the other price
    torch.testing.assert_close(10 * entropy_slopes[0], entropy_slopes[1], rtol=1e-3, atol=1e-6)
    assert lambda_of(lambda_q).tolist() == pytest.approx([1.478e-5, 7.66e-3], rel=0.01)


@pytest.fixture(scope="module")
def batch() -> Batch:
    return synthetic_batch()


@torch.no_grad()
def test_depth_of_photographs_is_judged_by_matched_depth_where_views_agree(networks: nn.ModuleDict, batch: Batch):
    outcomes, matched = run_stages(networks["sender"], networks["receiver"], batch, bypass_coding, 2)
    beside = outcomes[1].prediction.relative_disparity + 0.25
    all_agree = MatchedDisparity(matched.learned, beside.clamp(0.0, 1.0), torch.ones_like(beside))
    none_agree = replace(all_agree, consistency=torch.zeros_like(beside))

    def disparity(batch: Batch, matched: MatchedDisparity) -> float:
        return loss_of(batch, outcomes, matched, 1.0)[1]["disparity2"]

    photographs = replace(batch, depth=torch.full_like(batch.depth, torch.nan))
    assert disparity(photographs, all_agree) == pytest.approx(0.25, abs=0.01)
    assert disparity(photographs, none_agree) == 0.0
    assert disparity(batch, all_agree) == disparity(batch, none_agree) > 0.0  # exact depth needs no other


def test_depth_that_context_views_do_not_confirm_is_taken_from_targets_that_do(
    networks: nn.ModuleDict, batch: Batch, monkeypatch: pytest.MonkeyPatch
):
    def of_all_views(value: float) -> torch.Tensor:
        return torch.full((3, 1, 16, 16), value)

    calls: list[torch.Tensor] = []

    def match(images: torch.Tensor, cameras: Cameras) -> SimpleNamespace:
        calls.append(images)
        return SimpleNamespace(depth=MatchedDepth(of_all_views(0.9), of_all_views(0.8)))

    sender = networks["sender"]
    monkeypatch.setattr(sender.extractor, "match", match)
    consistency = torch.zeros(1, 2, 16, 16)
    consistency[..., :4] = 0.95
    alone = MatchedDisparity(torch.zeros(1, 2, 16, 16), torch.full((1, 2, 16, 16), 0.3), consistency)
    photographs = replace(batch, depth=torch.full_like(batch.depth, torch.nan))
    found = with_targets(sender, photographs, alone)
    assert calls[0].shape[1] == 3
    assert found.aggregated[..., :4].unique().tolist() == pytest.approx([0.3])
    assert found.aggregated[..., 4:].unique().tolist() == pytest.approx([0.9])
    assert found.consistency[..., 3:5].flatten().unique().tolist() == pytest.approx([0.8, 0.95])
    assert with_targets(sender, batch, alone) is alone
    assert len(calls) == 1  # exact depth needs no other


def test_a_third_stage_works_as_the_second_from_where_that_ends(networks: nn.ModuleDict, batch: Batch):
    kinds: list[int] = []
    contexts: list[torch.Tensor | None] = []

    def code(y: torch.Tensor, inputs: StageInputs) -> EstimatedLatent:
        kinds.append(inputs.stage)
        contexts.append(inputs.y_hat)
        return EstimatedLatent(y + len(kinds), y.abs().flatten(1).sum(dim=1))

    with torch.no_grad():
        outcomes, _ = run_stages(networks["sender"], networks["receiver"], batch, code, 3)
        two, _ = run_stages(networks["sender"], networks["receiver"], batch, code, 2)
    assert kinds == [1, 2, 2, 1, 2]
    assert contexts[0] is None
    assert not torch.equal(contexts[1], contexts[2])
    assert len(outcomes[1].renderings) == len(outcomes[2].renderings) == 1
    assert not torch.equal(outcomes[2].prediction.attributes.means, outcomes[1].prediction.attributes.means)
    assert len(two) == 2


def test_the_perceptual_distance_weights_context_and_target_views_by_number_and_weight() -> None:
    images = torch.rand(1, 5, 3, 32, 32, generator=torch.Generator().manual_seed(4))
    rendered = images.clone()
    rendered[:, 2:] = rendered[:, 2:].roll(16, dims=-1)
    images[:, 3:], rendered[:, 3:] = images[:, 2:3], rendered[:, 2:3]  # three equal targets; context views are exact
    weights = torch.tensor([0.5, 0.5, 2.0, 2.0, 2.0])
    expected = 3 / 5 * 2.0 * float(st_lpips(rendered[:, 2], images[:, 2]))
    assert expected > 0
    assert float(perceptual_distance(rendered, images, 2, weights)) == pytest.approx(expected, rel=1e-4)
