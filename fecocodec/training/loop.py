"""The training loop: optimisation steps, log, checkpoints, validation and pictures."""

import math
import time
from collections.abc import Iterator

from fecocodec.atomic import make_folder
from fecocodec.training.processes import broadcast_from_first, is_first
from fecocodec.training.run_files import append_row, mean_of_rows
from fecocodec.training.run_monitor import RunMonitor
from fecocodec.training.trainer import Trainer


def train(trainer: Trainer) -> Iterator[dict[str, float]]:
    """Train until the schedule or the time limit ends; yields a log row every `log_every` steps and at the end.

    A row holds means over its steps. Skipped batches are counted in the column `skipped` and excluded from means.
    Raises OutputError if files cannot be written.
    """
    settings, monitor = trainer.settings, RunMonitor(trainer)
    make_folder(settings.folder / "samples")
    start = saved = time.monotonic()
    drawn = -math.inf
    window: list[dict[str, float]] = []
    while trainer.step < settings.configuration.schedule.num_steps:
        parts = trainer.train_step()
        if math.isfinite(parts["gradient"]):
            window.append(parts)
        now = time.monotonic()
        is_over = broadcast_from_first(now - start > 60 * (settings.max_minutes or math.inf))
        if is_first() and now - drawn > 60 * settings.samples_every_minutes:
            monitor.draw_samples()
            drawn = now
        is_last = trainer.step == settings.configuration.schedule.num_steps
        validated = monitor.validate() if trainer.step % settings.validate_every == 0 or is_last else {}
        if trainer.step % settings.log_every == 0 or is_over or is_last or validated:
            row = mean_of_rows(window) | trainer.counts | {"minutes": (now - start) / 60} | validated
            window = []
            if is_first():
                append_row(trainer.log, row)
                yield row
        is_due = broadcast_from_first(now - saved > 60 * settings.save_every_minutes)
        if is_due or is_over:
            trainer.save(trainer.checkpoint)
            saved = now
        if trainer.step % settings.keep_every == 0:
            trainer.save(settings.folder / f"step_{trainer.step:07}.pt")
        if is_over:
            return
    trainer.save(trainer.checkpoint)
