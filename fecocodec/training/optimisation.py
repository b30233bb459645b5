"""What every phase of training does with gradients, and how its learning rate goes."""

import math

import torch
from torch import nn

from fecocodec.training.processes import average_gradients

LARGEST_GRADIENT = 1.0


def cosine_with_warm_up(peak: float, step: int, num_steps: int, warm_up: int) -> float:
    """Linear warm-up of so many steps, then cosine to zero."""
    progress = min(1.0, step / num_steps)
    return peak * min(1.0, (step + 1) / warm_up) * 0.5 * (1.0 + math.cos(math.pi * progress))


def clipped_step(optimiser: torch.optim.Optimizer, networks: nn.Module, learning_rate: float) -> float:
    """One step along the mean of the processes' gradients, clipped at norm 1; returns the norm.

    Where that is not finite the networks stay as they are.
    """
    average_gradients(networks)
    norm = nn.utils.clip_grad_norm_(networks.parameters(), LARGEST_GRADIENT, foreach=True)
    for group in optimiser.param_groups:
        group["lr"] = learning_rate
    if torch.isfinite(norm):
        optimiser.step()
    return float(norm)
