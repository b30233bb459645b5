"""Quantities of training that depend on the step."""

import math
from dataclasses import dataclass

from fecocodec.errors import InputError
from fecocodec.training.optimisation import cosine_with_warm_up


@dataclass(frozen=True)
class Schedule:
    """Phases of training: without a rate (one stage, then two), then rate-distortion; see `docs/training.md`.

    one_stage_until, bypass_until, warm_up: steps. photograph_share, disparity_weight: values at the first and last
    step, linear in between. Raises InputError for numbers out of range.
    """

    num_steps: int
    one_stage_until: int = 0
    bypass_until: int = 0
    learning_rate: float = 5e-4
    warm_up: int = 200
    photograph_share: tuple[float, float] = (0.4, 0.6)
    disparity_weight: tuple[float, float] = (1.0, 0.1)

    def __post_init__(self) -> None:
        if self.num_steps < 1 or self.warm_up < 1:
            raise InputError(f"A schedule of {self.num_steps} steps with {self.warm_up} of warm-up; give at least one.")
        if not 0 < self.learning_rate < math.inf:
            raise InputError(f"The learning rate is {self.learning_rate:g}; it must be positive.")
        if not all(0 <= share <= 1 for share in self.photograph_share):
            raise InputError(f"The share of photographs is {self.photograph_share}; give two numbers from 0 to 1.")
        if not all(0 <= weight < math.inf for weight in self.disparity_weight):
            raise InputError(f"The weight of depth is {self.disparity_weight}; give two numbers of 0 or more.")

    def learning_rate_at(self, step: int) -> float:
        """Return the learning rate at a step: linear warm-up, then cosine to zero."""
        return cosine_with_warm_up(self.learning_rate, step, self.num_steps, self.warm_up)

    def photograph_share_at(self, step: int) -> float:
        return self._between(self.photograph_share, step)

    def disparity_weight_at(self, step: int) -> float:
        return self._between(self.disparity_weight, step)

    def _between(self, ends: tuple[float, float], step: int) -> float:
        progress = min(1.0, step / self.num_steps)
        return ends[0] + (ends[1] - ends[0]) * progress
