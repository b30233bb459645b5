"""Training in a group of processes: gradients of the joint batch, and the same weights everywhere."""

import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import torch.distributed as dist
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.stages import EstimatedLatent, StageInputs
from fecocodec.training.batch import Batch
from fecocodec.training.loss import loss_of
from fecocodec.training.optimisation import Schedule
from fecocodec.training.processes import average_gradients, joined_processes, process_rank
from fecocodec.training.run_files import load_checkpoint
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import run_stages
from tests.training.tiny_runs import copied, synthetic_batch, tiny_trainer

ROOT = Path(__file__).resolve().parents[2]


def trainer(folder: Path) -> Trainer:
    """The rate counts from the third step."""
    return tiny_trainer(folder, Schedule(4, one_stage_until=1, bypass_until=2, warm_up=1))


def backward(it: Trainer, batch: Batch) -> None:
    """Gradients of one pass whose coding has neither noise nor rounding, so that nothing depends on who computes it."""

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        return EstimatedLatent(y, y.abs().flatten(1).sum(dim=1))

    outcomes, matched = run_stages(it.sender, it.receiver, batch, code, 2)
    loss_of(batch, outcomes, matched, 1.0)[0].backward()


def gradients_of(networks: nn.Module) -> dict[str, Tensor]:
    return {name: value.grad for name, value in networks.named_parameters() if value.grad is not None}


def joined(first: Batch, second: Batch) -> Batch:
    cameras = Cameras(*map(torch.cat, zip(first.cameras.fields(), second.cameras.fields(), strict=True)))
    parts = {name: torch.cat((getattr(first, name), getattr(second, name))) for name in ("images", "depth", "lambda_q")}
    return replace(first, cameras=cameras, **parts)


def leave_results(folder: Path) -> None:
    """What each process of the group does: average gradients of one batch, then train."""
    with joined_processes():
        it = trainer(folder)
        backward(it, synthetic_batch(seed=process_rank()))
        own = {name: gradient.clone() for name, gradient in gradients_of(it.networks).items()}
        average_gradients(it.networks)
        mean = gradients_of(it.networks)
        losses = [it.train_step()["loss"] for _ in range(4)]
        it.save(it.checkpoint)
        torch.save((own, mean, losses, copied(it.networks)), folder / f"{process_rank()}.pt")


def run_group(folder: Path) -> list[object]:
    """Run `leave_results` in a group of two processes; what each saved, by rank."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    group = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "TORCHELASTIC_RUN_ID": "test"}
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from pathlib import Path\n"
    code += f"from tests.training import test_several_processes as group; group.leave_results(Path({str(folder)!r}))"
    members = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            env={**os.environ, **group, "RANK": str(rank), "LOCAL_RANK": str(rank), "OMP_NUM_THREADS": "1"},
        )
        for rank in range(2)
    ]
    assert [member.wait(timeout=110) for member in members] == [0, 0]
    return [torch.load(folder / f"{rank}.pt", weights_only=True) for rank in range(2)]


@pytest.mark.slow
def test_two_processes_have_the_gradients_of_one_with_the_joint_batch_and_the_same_weights(tmp_path: Path) -> None:
    """Averaging is exact. The joint batch has the same gradients up to rounding, by their norms: convolutions of one
    and of two scenes round differently, and a splat at a threshold of the renderer then counts in one of them alone.
    Losses differ, because each process draws scenes of its own.
    """
    (own, first, losses, weights), (other, second, other_losses, other_weights) = run_group(tmp_path)  # type: ignore[misc]
    alone = trainer(tmp_path / "alone")
    backward(alone, joined(synthetic_batch(seed=0), synthetic_batch(seed=1)))
    expected = gradients_of(alone.networks)
    assert first.keys() == second.keys() == expected.keys() and len(expected) > 100
    for name, gradient in expected.items():
        mean = (own[name] + other[name]) / 2
        assert torch.equal(first[name], mean) and torch.equal(second[name], mean)
        assert float((mean - gradient).norm()) <= 2e-3 * float(gradient.norm()) + 1e-9
        if bool(mean.any()):
            assert float((own[name] - gradient).norm()) > 0.05 * float(gradient.norm())  # the scenes differ
    assert all(torch.equal(weights[name], value) for name, value in other_weights.items()) and losses != other_losses
    assert len(load_checkpoint(tmp_path / "last.pt")["generators"]) == 2


def test_a_parameter_without_gradient_here_counts_as_zero_where_others_have_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One process simulates a group: `all_reduce` returns what another process with the second layer would give."""
    layers = nn.ModuleList((nn.Linear(2, 2), nn.Linear(2, 2), nn.Linear(2, 2)))
    layers[0](torch.ones(1, 2)).sum().backward()
    dist.init_process_group("gloo", init_method=f"file://{tmp_path / 'store'}", rank=0, world_size=1)
    reduce = dist.all_reduce

    def with_another(tensor: Tensor, op: dist.ReduceOp = dist.ReduceOp.SUM) -> None:
        reduce(tensor, op)
        if tensor.dtype == torch.uint8:
            tensor[2:4] = 1

    monkeypatch.setattr(dist, "all_reduce", with_another)
    try:
        average_gradients(layers)
    finally:
        dist.destroy_process_group()
    assert torch.equal(layers[1].weight.grad, torch.zeros(2, 2))
    assert layers[2].weight.grad is None and bool(layers[0].weight.grad.any())
