"""The training loops: of all networks, with log, checkpoints, validation and pictures, and of one part alone."""

import math
import time
from collections.abc import Callable, Iterator

from torch import nn

from fecocodec.atomic import make_folder
from fecocodec.sender.codec import Codec
from fecocodec.training.configurations import Configuration
from fecocodec.training.optimisation import SkippedSteps, build_optimiser, clipped_step, copy_of_weights, update_average
from fecocodec.training.processes import broadcast_from_first, is_first
from fecocodec.training.run_files import append_row, mean_of_rows
from fecocodec.training.run_monitor import RunMonitor
from fecocodec.training.trainer import Trainer

SCENES_OF_A_STEP = 2  # of each process that trains one part alone


def train(trainer: Trainer, is_ending: Callable[[], bool] = lambda: False) -> Iterator[dict[str, float]]:
    """Train until the schedule or the time limit ends, or `is_ending` in the first process, after which it saves.

    Yields a log row every `log_every` steps and at the end.

    A row holds means over its steps. Skipped batches are counted in the column `skipped` and excluded from means.
    Raises InputError if the training diverges, OutputError if files cannot be written.
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
        is_over = broadcast_from_first(is_ending() or now - start > 60 * (settings.max_minutes or math.inf))
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
        is_kept = trainer.step % settings.keep_every == 0
        if is_kept:
            trainer.save(settings.folder / f"step_{trainer.step:07}.pt")
        if is_due or is_over or is_kept:
            trainer.save(trainer.checkpoint)
            saved = now
        if is_over:
            return
    trainer.save(trainer.checkpoint)


def train_alone(
    codec: Codec,
    part: nn.Module,
    configuration: Configuration,
    add_gradients: Callable[[], dict[str, float]],
    log_every: int,
) -> Iterator[dict[str, float]]:
    """Train one part of a codec alone, and give it its averaged weights at the end.

    configuration: its schedule and its optimiser count. add_gradients: adds the gradients of one scene to those of the
    part, and returns columns of the log. Every `log_every` steps, yields the number of steps, the number skipped
    because gradients were not finite, and means over scenes. Raises InputError if the training diverges.
    """
    schedule, decay = configuration.schedule, configuration.optimiser.average_decay
    for network in (codec.sender, codec.receiver):
        network.requires_grad_(False)
    optimiser = build_optimiser(part.requires_grad_(True), configuration.optimiser)
    average = copy_of_weights(part)
    window: list[dict[str, float]] = []
    skipped = SkippedSteps()
    for step in range(schedule.num_steps):
        optimiser.zero_grad(set_to_none=True)
        window += [add_gradients() for _ in range(SCENES_OF_A_STEP)]
        if skipped.is_taken(clipped_step(optimiser, part, schedule.learning_rate_at(step))):
            update_average(average, part, decay, step)
        if (step + 1) % log_every == 0 or step + 1 == schedule.num_steps:
            yield {"step": float(step + 1), "skipped": float(skipped.num)} | mean_of_rows(window)
            window = []
    part.load_state_dict(average)
    part.requires_grad_(False)
