"""Learning of the step network in training: its gradients, and what optimised latents do to those of the codec."""

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from fecocodec.config import SenderConfig
from fecocodec.errors import InputError
from fecocodec.progress import Progress
from fecocodec.sender.codec import Codec
from fecocodec.sender.distortion import MseDistortion
from fecocodec.sender.latent_optimisation import Objective, step_size
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.stages import StageInputs
from fecocodec.sender.step_network import StepNetwork
from fecocodec.training import loss, step_learning
from fecocodec.training import trainer as trainer_module
from fecocodec.training.batch import Batch
from fecocodec.training.configurations import Configuration
from fecocodec.training.optimisation import Schedule
from fecocodec.training.step_learning import CONTEXT_SHARE, LAST_WEIGHT, Evaluated, StepLearner, learn
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import BatchEncoder
from tests.training.tiny_runs import SHAPES, changed, copied, synthetic_batch, tiny_trainer

pytestmark = pytest.mark.usefixtures("one_thread")

STEPS = OptimisationConfig(num_steps=1, extra_step_below=(), distortion=MseDistortion())


def new_trainer(folder: Path, share: float) -> Trainer:
    schedule = Schedule(4, one_stage_until=0, bypass_until=0)
    return tiny_trainer(folder, schedule, sender=SenderConfig(step_channels=16), optimised_share=share)


@torch.enable_grad()
def two_parabolas(y: Tensor) -> Evaluated:
    """Encoding lowers the distance of y to 1 and to 0; target views want 2, perception 3."""
    y = y.detach().requires_grad_()
    distortion, rate, target = ((y - wanted).square().mean() for wanted in (1.0, 0.0, 2.0))
    total = CONTEXT_SHARE * distortion + (1.0 - CONTEXT_SHARE) * target + rate
    objective = Objective(distortion, rate, torch.ones(1, 3, 32, 32))

    def perceptual() -> Tensor:
        return (y - 3.0).square().mean()

    return Evaluated(y, objective, target, perceptual, {"loss": float(total.detach())})


@pytest.mark.parametrize("perceptual_weight", [0.0, 0.5])
def test_gradients_are_those_of_the_loss_by_the_network(codec: Codec, perceptual_weight: float) -> None:
    condition = codec.receiver.condition(torch.tensor([300]), 1)
    torch.manual_seed(1)
    network, y = StepNetwork(32, 128, 16), torch.randn(1, 32, 4, 4)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.1)

    given = torch.randn(1, 128, 8, 8), torch.randn(1, 128, 1, 1), condition

    def loss_of(other: StepNetwork) -> float:
        """Of the latents after the one step."""
        found, before, after = learn(other, two_parabolas, y, 1, 0.5, given, perceptual_weight)
        assert before["loss"] == two_parabolas(y).parts["loss"] and after == two_parabolas(found).parts
        return LAST_WEIGHT * (after["loss"] + perceptual_weight * float((found - 3.0).square().mean()))

    loss_of(network)
    direction = {name: torch.randn_like(parameter) for name, parameter in network.named_parameters()}
    expected = sum(float((p.grad * direction[n]).sum()) for n, p in network.named_parameters() if p.grad is not None)
    ends = []
    for distance in (1e-3, -1e-3):
        moved = copy.deepcopy(network)
        with torch.no_grad():
            for name, parameter in moved.named_parameters():
                parameter += distance * direction[name]
        ends.append(loss_of(moved))
    assert (ends[0] - ends[1]) / 2e-3 == pytest.approx(expected, rel=0.02)


def new_learner(seed: int) -> StepLearner:
    return StepLearner(StepNetwork(32, 128, 16), STEPS, torch.Generator().manual_seed(seed))


def optimised(
    codec: Codec, batch: Batch, scenes: list[int], seed: int, learner: StepLearner | None = None, num_views: int = 2
) -> tuple[Tensor, Tensor, list[dict[str, float]]]:
    """Latents of stage 1 of these scenes before and after their steps, and what the steps change."""
    batch = batch.mapped(lambda values: values[scenes])
    encoder = BatchEncoder(codec.sender, codec.receiver, batch)
    torch.manual_seed(2)
    rows: list[dict[str, float]] = []
    learner = new_learner(seed) if learner is None else learner
    lambda_q = batch.lambda_q.repeat_interleave(num_views)
    condition = codec.receiver.condition(lambda_q, 1)
    inputs = StageInputs(1, True, lambda_q, condition, encoder.initial_state, None)
    items = num_views * len(scenes)
    y = (4.0 * torch.randn(items, 32, 8, 8, generator=torch.Generator().manual_seed(7))).requires_grad_()
    features = torch.ones(items, 128, 16, 16)
    return y, learner.optimiser(encoder, batch, rows.append)(y, features, inputs, Progress()), rows


def test_the_perceptual_part_of_the_loss_is_st_lpips_weighted_as_d(
    codec: Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With every ST-LPIPS at 1, the part is 1 for any number of views."""
    seen: list[Tensor] = []

    def one(images: Tensor, targets: Tensor) -> Tensor:
        assert images.shape == targets.shape == (1, 2, 3, 64, 64)
        seen.append(targets)
        return torch.ones(1, 2) + 0.0 * images.sum()

    batch = synthetic_batch(num_context=3, num_target=2, seed=4)
    monkeypatch.setattr(loss, "st_lpips", one)
    values: list[float] = []
    learned = step_learning.learn

    def watched(network: StepNetwork, evaluate: Any, y: Tensor, *others: Any) -> Any:
        values.append(float(evaluate(y).perceptual().detach()))
        return learned(network, evaluate, y, *others)

    monkeypatch.setattr(step_learning, "learn", watched)
    optimised(codec, batch, [0], 1, replace(new_learner(1), perceptual_weight=0.5), num_views=3)
    assert values == [pytest.approx(1.0)] and len(seen) == 2
    for context, target in (pictures[0] for pictures in seen):
        assert any(torch.equal(context, image) for image in batch.images[0, :3])
        assert any(torch.equal(target, image) for image in batch.images[0, 3:])


def test_scenes_of_a_batch_are_optimised_as_if_alone(codec: Codec) -> None:
    batch = synthetic_batch(num_scenes=2, seed=4)
    seed = next(s for s in range(99) if float(torch.rand((), generator=torch.Generator().manual_seed(s))) > 0.9)
    _, both, _ = optimised(codec, batch, [0, 1], seed)
    y, first, _ = optimised(codec, batch, [0], seed)
    assert float((first - y[:2]).detach().abs().mean()) > 0.01
    assert torch.allclose(both[:2], first, atol=1e-4)


def test_training_through_steps_trains_receiver_and_step_network_and_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer_module, "DEFAULT", STEPS)
    whole = new_trainer(tmp_path / "whole", 1.0)
    before = copied(whole.networks)
    whole.train_step()
    learned = {".".join(name.split(".")[:2]) for name in changed(whole.networks, before)}
    assert {"sender.steps", "receiver.synthesis", "receiver.update", "receiver.predictor", "receiver.prior"} <= learned
    assert {"sender.analysis", "sender.feedback"} <= learned
    whole.save(whole.checkpoint)
    again = new_trainer(tmp_path / "again", 1.0)
    again.resume(whole.checkpoint)
    assert whole.train_step() == pytest.approx(again.train_step(), rel=1e-4)  # gradients are summed in any order


def test_the_sender_learns_by_the_distance_to_the_optimised_latents_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer_module, "DEFAULT", STEPS)
    monkeypatch.setattr(step_learning, "ANALYSIS_WEIGHT", 0.0)
    trainer = new_trainer(tmp_path, 1.0)
    assert trainer.train_step()["analysis"] == 0.0
    gradients = [p.grad for p in trainer.sender.analysis.parameters() if p.grad is not None]
    assert gradients and all(bool((gradient == 0.0).all()) for gradient in gradients)


def test_the_distance_of_g_a_counts_in_first_steps(codec: Codec) -> None:
    batch = synthetic_batch(num_scenes=2, seed=4)
    batch = replace(batch, lambda_q=torch.tensor([0, 1768]))
    learner = new_learner(1)
    y, found, rows = optimised(codec, batch, [0, 1], 1, learner)
    fine, coarse = (step_size(codec.receiver.condition(torch.tensor([value]), 1)) for value in (0, 1768))
    assert fine > 2.0 * coarse
    assert [set(row) for row in rows] == 2 * [{"loss1", "context1", "target1", "log_bits1"}]
    assert not torch.equal(found, y) and not found.requires_grad  # no gradient to the sender through the steps
    lengths = torch.tensor([fine, fine, coarse, coarse])[:, None, None, None]
    expected = ((y - found).detach() / lengths).square().mean()
    distance = learner.analysis_loss()
    assert float(distance.detach()) == pytest.approx(float(step_learning.ANALYSIS_WEIGHT * expected), rel=1e-5)
    distance.backward()
    assert y.grad is not None and bool(((y - found) * y.grad >= 0.0).all()) and float(y.grad.abs().sum()) > 0.0


def test_without_a_share_the_step_network_rests_and_a_share_needs_it(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path, 0.0)
    trainer.train_step()
    assert trainer.sender.steps is not None
    assert all(parameter.grad is None for parameter in trainer.sender.steps.parameters())
    with pytest.raises(InputError, match="leave out `optimised_share`, or choose the configuration compact"):
        Configuration(SHAPES, Schedule(1), optimised_share=0.5)
