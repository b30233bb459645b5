"""The optimiser and its step, and the quantities of training that depend on the step."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from fecocodec.errors import InputError
from fecocodec.training.processes import average_gradients

LARGEST_GRADIENT = 1.0
MOST_SKIPPED = 10  # successive steps, after which the training has diverged
BACKBONE = "sender.extractor.pretrained."  # parameters of the pretrained monocular ViT
SHARE = "learning_rate_share"  # of a parameter group


@dataclass(frozen=True)
class OptimiserConfig:
    """AdamW's parameters, and the averaging of weights.

    average_decay: of the averaged weights, which are exported; 0 exports the weights of the last step. backbone_share:
    learning rate of the pretrained monocular backbone, as a share of that of all other parameters.
    """

    betas: tuple[float, float] = (0.9, 0.99)
    weight_decay: float = 1e-4
    average_decay: float = 0.998
    backbone_share: float = 1.0


def build_optimiser(networks: nn.Module, config: OptimiserConfig) -> torch.optim.Optimizer:
    """Return AdamW over all trainable parameters, with a group for the backbone if its learning rate differs."""
    learning = {name: p for name, p in networks.named_parameters() if p.requires_grad}
    has_group = config.backbone_share != 1.0
    backbone = [p for name, p in learning.items() if has_group and name.startswith(BACKBONE)]
    others = [p for name, p in learning.items() if not (has_group and name.startswith(BACKBONE))]
    groups: list[dict[str, object]] = [{"params": others}]
    if backbone:
        groups.append({"params": backbone, SHARE: config.backbone_share})
    return torch.optim.AdamW(groups, lr=1.0, betas=config.betas, weight_decay=config.weight_decay, fused=True)


def clipped_step(optimiser: torch.optim.Optimizer, networks: nn.Module, learning_rate: float) -> float:
    """Average the gradients over the processes, clip them to norm 1 and take one step.

    Returns the norm before clipping. If the norm is not finite, no step is taken.
    """
    average_gradients(networks)
    norm = nn.utils.clip_grad_norm_(networks.parameters(), LARGEST_GRADIENT, foreach=True)
    for group in optimiser.param_groups:
        group["lr"] = learning_rate * group.get(SHARE, 1.0)
    if torch.isfinite(norm):
        optimiser.step()
    return float(norm)


@dataclass
class SkippedSteps:
    """Counts the steps that were skipped because gradients were not finite: all, and the last ones in succession."""

    num: int = 0
    num_successive: int = 0

    def is_taken(self, norm: float) -> bool:
        """Return whether a step was taken, by the norm of its gradients.

        Raises InputError if it is the last of MOST_SKIPPED successive steps that were not.
        """
        if math.isfinite(norm):
            self.num_successive = 0
            return True
        self.num, self.num_successive = self.num + 1, self.num_successive + 1
        if self.num_successive == MOST_SKIPPED:
            raise InputError(
                f"The training has diverged: the gradients of {MOST_SKIPPED} successive steps were not finite; "
                "train in another folder with a smaller `learning_rate`."
            )
        return False


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
        """Return the learning rate at a step: linear warm-up over `warm_up` steps, times a cosine to zero."""
        cosine = 0.5 * (1.0 + math.cos(math.pi * min(1.0, step / self.num_steps)))
        return self.learning_rate * min(1.0, (step + 1) / self.warm_up) * cosine

    def photograph_share_at(self, step: int) -> float:
        return self._between(self.photograph_share, step)

    def disparity_weight_at(self, step: int) -> float:
        return self._between(self.disparity_weight, step)

    def _between(self, ends: tuple[float, float], step: int) -> float:
        progress = min(1.0, step / self.num_steps)
        return ends[0] + (ends[1] - ends[0]) * progress


def copy_of_weights(networks: nn.Module) -> dict[str, Tensor]:
    """Return a copy of the state, with which an average of weights begins."""
    return {name: value.detach().clone() for name, value in networks.state_dict().items()}


@torch.no_grad()
def update_average(average: dict[str, Tensor], networks: nn.Module, largest_decay: float, step: int) -> None:
    """Move an exponential average of weights towards the weights after a step. The decay grows with the steps."""
    decay = min(largest_decay, (1 + step) / (10 + step))
    torch._foreach_lerp_(list(average.values()), list(networks.state_dict().values()), 1.0 - decay)
