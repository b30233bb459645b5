"""bfloat16: what is converted, what is not, and that the result is still the same codec."""

import copy

import pytest
import torch
from torch import nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender
from fecocodec.sender.precision import run_in_bfloat16
from fecocodec.training.batch import Batch
from fecocodec.training.loss import loss_of
from fecocodec.training.training_pass import bypass_coding, run_stages
from tests.training.tiny_runs import synthetic_batch


@pytest.fixture(scope="module")
def batch() -> Batch:
    return synthetic_batch()


@pytest.fixture(scope="module")
def networks() -> nn.ModuleDict:
    torch.manual_seed(0)
    config = ReceiverConfig()
    return nn.ModuleDict({"receiver": Receiver(config), "sender": Sender(SenderConfig(), config)})


@pytest.fixture
def converted(networks: nn.ModuleDict) -> nn.ModuleDict:
    copied = copy.deepcopy(networks)
    run_in_bfloat16(copied, "cpu")
    return copied


def seen_dtypes(networks: nn.ModuleDict, batch: Batch) -> dict[str, set[torch.dtype]]:
    """Types of what every module computes in one pass, by its name."""
    seen: dict[str, set[torch.dtype]] = {}

    def watch(name: str, module: nn.Module) -> None:
        def note(_module: nn.Module, _inputs: object, output: object) -> None:
            if isinstance(output, torch.Tensor):
                seen.setdefault(name, set()).add(output.dtype)

        module.register_forward_hook(note)

    for name, module in networks.named_modules():
        watch(name, module)
    outcomes, _ = run_stages(networks["sender"], networks["receiver"], batch, bypass_coding, 2)
    assert all(field.dtype == torch.float32 for field in outcomes[1].prediction.attributes.gaussians().fields())
    return seen


def test_blocks_run_in_bfloat16_and_depth_matching_and_points_do_not(converted: nn.ModuleDict, batch: Batch) -> None:
    seen = seen_dtypes(converted, batch)
    assert seen["sender.extractor.coarse.0.spatial"] == {torch.bfloat16}
    assert seen["receiver.synthesis.coarse.0.spatial"] == {torch.bfloat16}
    for name in (
        "receiver.predictor.depth_head",
        "sender.extractor.matching_head",
        "receiver.predictor.attention.offset_bias",
    ):
        assert seen[name] == {torch.float32}
    parts = ("receiver.synthesis", "receiver.update", "sender.analysis", "sender.feedback", "receiver.predictor.fine")
    assert all(seen[name] == {torch.float32} for name in parts)


def test_the_loss_is_nearly_that_of_float32_and_gradients_are_float32(
    networks: nn.ModuleDict, converted: nn.ModuleDict, batch: Batch
) -> None:
    losses = []
    for variant in (networks, converted):
        torch.manual_seed(1)
        outcomes, matched = run_stages(variant["sender"], variant["receiver"], batch, bypass_coding, 2)
        losses.append(loss_of(batch, outcomes, matched, 1.0)[0])
    assert float(losses[1].detach()) == pytest.approx(float(losses[0].detach()), rel=0.02)
    losses[1].backward()
    gradients = [parameter.grad for parameter in converted.parameters() if parameter.grad is not None]
    assert gradients and all(gradient.dtype == torch.float32 for gradient in gradients)
