"""Settings of a training run."""

from dataclasses import dataclass
from pathlib import Path

from fecocodec.training.configurations import Configuration


@dataclass(frozen=True)
class RunSettings:
    """Where and how long a run trains, and what it writes; what it trains is in the configuration.

    max_minutes: save and stop after this time; None for no limit. device: where the networks run, `cpu` or `cuda:N`;
    batches are drawn on the CPU. num_workers: processes that draw batches ahead; with 0 the training process does.
    validate_every, keep_every: steps between validations, and between checkpoints that are kept, with a number.
    validation_scenes: number of held-out scenes.
    """

    folder: Path
    configuration: Configuration
    max_minutes: float | None
    seed: int = 0
    device: str = "cpu"
    log_every: int = 50
    save_every_minutes: float = 5.0
    samples_every_minutes: float = 15.0
    num_workers: int = 0
    validate_every: int = 5_000
    validation_scenes: int = 8
    keep_every: int = 25_000
