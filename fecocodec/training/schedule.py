"""What changes while training goes on, as functions of the step."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """Steps of the phases of docs: bypass (one stage, then two), then rate-distortion; see `docs/training.md`.

    one_stage_until, bypass_until: steps. photograph_share grows linearly from start to end over all steps.
    """

    num_steps: int
    one_stage_until: int = 0
    bypass_until: int = 0
    learning_rate: float = 5e-4
    warm_up: int = 200
    photograph_share: tuple[float, float] = (0.4, 0.6)
    disparity_weight: tuple[float, float] = (1.0, 0.1)

    def learning_rate_at(self, step: int) -> float:
        """Linear warm-up, then cosine to 2% of the peak."""
        progress = min(1.0, step / self.num_steps)
        cosine = 0.5 * (1.0 + math.cos(math.pi * progress))
        return self.learning_rate * min(1.0, (step + 1) / self.warm_up) * (0.02 + 0.98 * cosine)

    def photograph_share_at(self, step: int) -> float:
        return self._between(self.photograph_share, step)

    def disparity_weight_at(self, step: int) -> float:
        return self._between(self.disparity_weight, step)

    def num_stages_at(self, step: int) -> int:
        return 1 if step < self.one_stage_until else 2

    def _between(self, ends: tuple[float, float], step: int) -> float:
        progress = min(1.0, step / self.num_steps)
        return ends[0] + (ends[1] - ends[0]) * progress
