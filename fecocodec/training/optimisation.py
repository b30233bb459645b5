"""Optimiser step and learning-rate schedule shared by the phases of training."""

import math

import torch
from torch import nn

from fecocodec.training.processes import average_gradients

LARGEST_GRADIENT = 1.0


def cosine_with_warm_up(peak: float, step: int, num_steps: int, warm_up: int) -> float:
    """Return the learning rate at `step`: linear warm-up over `warm_up` steps, times a cosine from `peak` to zero."""
    progress = min(1.0, step / num_steps)
    return peak * min(1.0, (step + 1) / warm_up) * 0.5 * (1.0 + math.cos(math.pi * progress))


def clipped_step(optimiser: torch.optim.Optimizer, networks: nn.Module, learning_rate: float) -> float:
    """Average the gradients over the processes, clip them to norm 1 and take one step.

    Returns the norm before clipping. If the norm is not finite, no step is taken.
    """
    average_gradients(networks)
    norm = nn.utils.clip_grad_norm_(networks.parameters(), LARGEST_GRADIENT, foreach=True)
    for group in optimiser.param_groups:
        group["lr"] = learning_rate
    if torch.isfinite(norm):
        optimiser.step()
    return float(norm)
