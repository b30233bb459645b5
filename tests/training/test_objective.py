"""What a bit costs in training: lambda for the latents, one price for the entropy model."""

import pytest
import torch
from torch import nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.dataset import Sources, draw_batch
from fecocodec.training.objective import ENTROPY_PRICE, code_with_noise, lambda_of, run_stages
from fecocodec.training.scenes import ProceduralWorld
from fecocodec.training.textures import pattern_textures


@pytest.fixture(scope="module")
def networks() -> nn.ModuleDict:
    torch.manual_seed(0)
    config = ReceiverConfig()
    return nn.ModuleDict({"receiver": Receiver(config), "sender": Sender(SenderConfig(), config)})


@pytest.fixture(scope="module")
def latent() -> torch.Tensor:
    return 3.0 * torch.randn(2, 32, 8, 8, generator=torch.Generator().manual_seed(1))


def test_latents_pass_through_with_the_gradient_of_what_they_were(networks: nn.ModuleDict, latent: torch.Tensor):
    y = latent.clone().requires_grad_()
    y_hat, _ = code_with_noise(networks["receiver"], networks["sender"])(y, torch.tensor([100, 1700]), 1, None)
    assert 0.0 < float((y_hat - y).detach().abs().max()) <= 0.5 + 1e-3
    y_hat.sum().backward()
    assert torch.equal(y.grad, torch.ones_like(y))


def test_a_bit_costs_a_latent_lambda_and_the_entropy_model_one_price(
    networks: nn.ModuleDict, latent: torch.Tensor, monkeypatch: pytest.MonkeyPatch
):
    lambda_q = torch.tensor([100, 1700])
    slopes, entropy_slopes = [], []
    for price in (ENTROPY_PRICE, 10 * ENTROPY_PRICE):
        monkeypatch.setattr("fecocodec.training.objective.ENTROPY_PRICE", price)
        networks.zero_grad()
        y, context = latent.clone().requires_grad_(), latent.clone().requires_grad_()
        torch.manual_seed(2)
        _, bits = code_with_noise(networks["receiver"], networks["sender"])(y, lambda_q, 2, context)
        (price * bits).sum().backward()
        slopes.append((y.grad, context.grad))
        entropy_slopes.append(networks["receiver"].prior.enter.weight.grad.clone())
    for first, second in zip(*slopes, strict=True):
        torch.testing.assert_close(first, second, rtol=1e-3, atol=1e-7)  # lambda's alone, whatever the other price
    torch.testing.assert_close(10 * entropy_slopes[0], entropy_slopes[1], rtol=1e-3, atol=1e-6)
    assert lambda_of(lambda_q).tolist() == pytest.approx([1.478e-5, 7.66e-3], rel=0.01)


def test_a_third_stage_works_as_the_second_from_where_that_ends(networks: nn.ModuleDict):
    batch = draw_batch(
        Sources(ProceduralWorld(pattern_textures(5)), None),
        torch.Generator().manual_seed(0),
        BatchShape(1, 2, 1, (64, 64)),
        0.0,
    )
    kinds: list[int] = []
    contexts: list[torch.Tensor | None] = []

    def code(y: torch.Tensor, lambda_q: torch.Tensor, stage: int, context: torch.Tensor | None):
        kinds.append(stage)
        contexts.append(context)
        return y + len(kinds), y.abs().flatten(1).sum(dim=1)

    with torch.no_grad():
        outcomes, _ = run_stages(networks["sender"], networks["receiver"], batch, code, 3)
        two, _ = run_stages(networks["sender"], networks["receiver"], batch, code, 2)
    assert kinds == [1, 2, 2, 1, 2]
    assert contexts[0] is None
    assert not torch.equal(contexts[1], contexts[2])
    assert len(outcomes[1].renderings) == len(outcomes[2].renderings) == 1
    assert not torch.equal(outcomes[2].prediction.gaussians.means, outcomes[1].prediction.gaussians.means)
    assert len(two) == 2
