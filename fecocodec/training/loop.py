"""The training loop: steps, averaged weights, log, checkpoints."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, load_into
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.errors import ModelError
from fecocodec.layers.placement import place
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.sender.load import load_sender
from fecocodec.sender.model import Sender
from fecocodec.training.checkpoint import load_checkpoint, save_checkpoint
from fecocodec.training.dataset import BatchShape, Sources, draw_batch
from fecocodec.training.log import append_row, mean_of_rows
from fecocodec.training.objective import bypass_coding, code_with_noise, loss_of, run_stages
from fecocodec.training.processes import average_gradients, gather_states, is_first, process_rank, told_by_first
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
        torch.manual_seed(settings.seed)  # every process starts from the same weights
        receiver_config = ReceiverConfig()
        self.receiver = Receiver(receiver_config)
        self.sender = Sender(SenderConfig(), receiver_config)
        self.networks = nn.ModuleDict({"receiver": self.receiver, "sender": self.sender})
        place(self.networks, "cpu")
        self.average = {name: value.detach().clone() for name, value in self.networks.state_dict().items()}
        self.optimiser = torch.optim.AdamW(
            self.networks.parameters(), lr=1.0, betas=(0.9, 0.95), weight_decay=1e-4, fused=True
        )
        self.generator = torch.Generator().manual_seed(settings.seed * 1000 + process_rank())
        torch.manual_seed(settings.seed * 1000 + process_rank())  # and goes on with noise of its own
        self.step, self.num_skipped = 0, 0
        self.coding = code_with_noise(self.receiver, self.sender)

    @property
    def checkpoint(self) -> Path:
        """The file that `run` saves to and `resume` goes on from."""
        return self.settings.folder / "last.pt"

    def start_from(self, model: Path) -> None:
        """Begin with the weights of a released model's folder; raises ModelError where they are missing."""
        receiver, model_id = load_receiver(model / RECEIVER_FILE)
        sender = load_sender(model / SENDER_FILE, receiver.config, model_id)
        for network, released in ((self.receiver, receiver), (self.sender, sender)):
            load_into(network, released.state_dict(), model)
        self.average = {name: value.detach().clone() for name, value in self.networks.state_dict().items()}

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, exactly; raises ModelError where it is not one of these networks and processes."""
        saved = load_checkpoint(path)
        try:
            generator, noise = (saved[name][process_rank()] for name in ("generators", "global_generators"))
            self.networks.load_state_dict(saved["networks"])
            self.optimiser.load_state_dict(saved["optimiser"])
            self.average, self.step, self.num_skipped = saved["average"], saved["step"], saved["num_skipped"]
        except (KeyError, IndexError, RuntimeError, ValueError) as error:
            raise ModelError(
                f"{path}: not a checkpoint of these networks with so many processes ({type(error).__name__}); "
                "train with as many processes as before, or in another folder."
            ) from error
        self.generator.set_state(generator)
        torch.set_rng_state(noise)

    def save(self, path: Path) -> None:
        """Write everything `resume` needs; every process must call it, the first one writes."""
        contents: dict[str, Any] = {
            "networks": self.networks.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "num_skipped": self.num_skipped,
            "generators": gather_states(self.generator.get_state()),
            "global_generators": gather_states(torch.get_rng_state()),
        }
        if is_first():
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
        average_gradients(self.networks)
        norm = nn.utils.clip_grad_norm_(self.networks.parameters(), LARGEST_GRADIENT, foreach=True)
        for group in self.optimiser.param_groups:
            group["lr"] = schedule.learning_rate_at(self.step)
        if torch.isfinite(norm):
            self.optimiser.step()
            self._update_average()
        else:
            self.num_skipped += 1
        self.step += 1
        return parts | {"loss": float(loss.detach()), "gradient": float(norm)}

    @torch.no_grad()
    def _update_average(self) -> None:
        decay = min(AVERAGE_DECAY, (1 + self.step) / (10 + self.step))
        torch._foreach_lerp_(list(self.average.values()), list(self.networks.state_dict().values()), 1.0 - decay)

    def run(self) -> Iterator[dict[str, float]]:
        """Train until the schedule or the time ends; yields the mean of the log's columns every `log_every` steps."""
        settings = self.settings
        settings.folder.mkdir(parents=True, exist_ok=True)
        start = saved = time.monotonic()
        window: list[dict[str, float]] = []
        while self.step < settings.schedule.num_steps:
            window.append(self.train_step())
            now = time.monotonic()
            if self.step % settings.log_every == 0:
                counts = {"step": float(self.step), "minutes": (now - start) / 60, "skipped": float(self.num_skipped)}
                row = mean_of_rows(window) | counts
                window = []
                if is_first():
                    append_row(settings.folder / "log.csv", row)
                    yield row
            is_over = told_by_first(now - start > 60 * settings.max_minutes)
            is_due = told_by_first(now - saved > 60 * settings.save_every_minutes)
            if is_due or is_over:
                self.save(self.checkpoint)
                saved = now
            if is_over:
                return
        self.save(self.checkpoint)
