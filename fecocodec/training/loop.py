"""The training loop: steps, averaged weights, log, checkpoints."""

import csv
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender
from fecocodec.training.checkpoint import load_checkpoint, save_checkpoint
from fecocodec.training.dataset import BatchShape, Sources, draw_batch
from fecocodec.training.objective import bypass_coding, code_with_noise, loss_of, run_stages
from fecocodec.training.schedule import Schedule

AVERAGE_DECAY = 0.999
LARGEST_GRADIENT = 1.0


@dataclass(frozen=True)
class RunSettings:
    """Where a run keeps its files and when it stops and saves."""

    folder: Path
    max_minutes: float
    shape: BatchShape
    schedule: Schedule
    seed: int = 0
    log_every: int = 50
    save_every_minutes: float = 5.0


class Trainer:
    """Both ends' networks with optimiser, averaged weights and generator; resumes from `folder/last.pt`."""

    def __init__(self, settings: RunSettings, sources: Sources) -> None:
        self.settings, self.sources = settings, sources
        torch.manual_seed(settings.seed)
        receiver_config = ReceiverConfig()
        self.receiver = Receiver(receiver_config)
        self.sender = Sender(SenderConfig(), receiver_config)
        self.networks = nn.ModuleDict({"receiver": self.receiver, "sender": self.sender})
        self.networks.to(memory_format=torch.channels_last)
        self.average = {name: value.detach().clone() for name, value in self.networks.state_dict().items()}
        self.optimiser = torch.optim.AdamW(self.networks.parameters(), lr=1.0, betas=(0.9, 0.95), weight_decay=1e-4, fused=True)
        self.generator = torch.Generator().manual_seed(settings.seed * 1000 + _rank())
        self.step, self.num_skipped = 0, 0
        self.coding = code_with_noise(self.receiver, self.sender)

    @property
    def checkpoint(self) -> Path:
        """The file that `run` saves to and `resume` goes on from."""
        return self.settings.folder / "last.pt"

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, exactly."""
        saved = load_checkpoint(path)
        self.networks.load_state_dict(saved["networks"])
        self.average = saved["average"]
        self.optimiser.load_state_dict(saved["optimiser"])
        self.step, self.num_skipped = saved["step"], saved["num_skipped"]
        self.generator.set_state(saved["generators"][_rank()])
        torch.set_rng_state(saved["global_generators"][_rank()])

    def save(self, path: Path) -> None:
        """Write everything `resume` needs; every process must call it, the first one writes."""
        contents: dict[str, Any] = {
            "networks": self.networks.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "num_skipped": self.num_skipped,
            "generators": _gather(self.generator.get_state()),
            "global_generators": _gather(torch.get_rng_state()),
        }
        if _rank() == 0:
            save_checkpoint(path, contents)

    def train_step(self) -> dict[str, float]:
        """Draw a batch, take one step, return the parts of the loss; a batch with non-finite gradients is skipped."""
        schedule = self.settings.schedule
        batch = draw_batch(self.sources, self.generator, self.settings.shape, schedule.photograph_share_at(self.step))
        coding = bypass_coding if self.step < schedule.bypass_until else self.coding
        outcomes, matched = run_stages(self.sender, self.receiver, batch, coding, schedule.num_stages_at(self.step))
        loss, parts = loss_of(batch, outcomes, matched, schedule.disparity_weight_at(self.step))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        _average_gradients(self.networks)
        norm = nn.utils.clip_grad_norm_(self.networks.parameters(), LARGEST_GRADIENT, foreach=True)
        for group in self.optimiser.param_groups:
            group["lr"] = schedule.learning_rate_at(self.step)
        if torch.isfinite(norm):
            self.optimiser.step()
            self._update_average()
        else:
            self.num_skipped += 1
        self.step += 1
        return parts | {"loss": float(loss), "gradient": float(norm)}

    @torch.no_grad()
    def _update_average(self) -> None:
        decay = min(AVERAGE_DECAY, (1 + self.step) / (10 + self.step))
        torch._foreach_lerp_(list(self.average.values()), list(self.networks.state_dict().values()), 1.0 - decay)

    def run(self) -> Iterator[dict[str, float]]:
        """Train until the schedule or the time ends; yields the mean of the log's columns every `log_every` steps."""
        folder = self.settings.folder
        folder.mkdir(parents=True, exist_ok=True)
        start = saved = time.monotonic()
        window: list[dict[str, float]] = []
        while self.step < self.settings.schedule.num_steps:
            window.append(self.train_step())
            now = time.monotonic()
            if self.step % self.settings.log_every == 0:
                row = _mean(window) | {"step": float(self.step), "minutes": (now - start) / 60, "skipped": float(self.num_skipped)}
                window = []
                if _rank() == 0:
                    append_row(folder / "log.csv", row)
                    yield row
            is_over, is_due = _agree(now - start > 60 * self.settings.max_minutes, now - saved > 60 * self.settings.save_every_minutes)
            if is_due or is_over:
                self.save(self.checkpoint)
                saved = now
            if is_over:
                return
        self.save(self.checkpoint)


@contextmanager
def joined_processes() -> Iterator[None]:
    """Join the process group that a launcher such as `torchrun` describes in the environment; alone without one."""
    if not dist.is_torchelastic_launched():
        yield
        return
    dist.init_process_group("nccl" if torch.cuda.is_available() else "gloo")
    try:
        yield
    finally:
        dist.destroy_process_group()


def append_row(path: Path, row: dict[str, float]) -> None:
    """Add a row to a CSV log; columns are those of the first row, what is missing stays empty."""
    is_new = not path.exists()
    columns = LOG_COLUMNS
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        if is_new:
            writer.writeheader()
        writer.writerow({name: f"{value:.6g}" for name, value in row.items()})


LOG_COLUMNS = [
    "step", "minutes", "loss", "mse1", "mse2", "mse_context1", "mse_context2", "bpp1", "bpp2",
    "matching", "disparity1", "disparity2", "gradient", "skipped",
]  # fmt: skip


def _mean(rows: list[dict[str, float]]) -> dict[str, float]:
    names = {name for row in rows for name in row}
    return {name: sum(row[name] for row in rows if name in row) / sum(name in row for row in rows) for name in names}


def _rank() -> int:
    return dist.get_rank() if dist.is_initialized() else 0


def _gather(state: Tensor) -> list[Tensor]:
    if not dist.is_initialized():
        return [state]
    states: list[Tensor] = [torch.empty_like(state) for _ in range(dist.get_world_size())]
    dist.all_gather(states, state)
    return states


def _agree(*flags: bool) -> tuple[bool, ...]:
    """What the first process says: all must save and stop at the same step."""
    if not dist.is_initialized():
        return flags
    values = torch.tensor([float(flag) for flag in flags])
    dist.broadcast(values, 0)
    return tuple(bool(value) for value in values)


def _average_gradients(networks: nn.Module) -> None:
    """Mean of the processes' gradients, in one message; does nothing in a single process."""
    if not dist.is_initialized():
        return
    gradients = [p.grad if p.grad is not None else torch.zeros_like(p) for p in networks.parameters()]
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    dist.all_reduce(flat)
    flat /= dist.get_world_size()
    for parameter, gradient in zip(networks.parameters(), flat.split([g.numel() for g in gradients]), strict=True):
        parameter.grad = gradient.view(parameter.shape)
