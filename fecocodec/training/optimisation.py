"""Optimiser, its step, and the learning-rate schedule, shared by the phases of training."""

import math
from dataclasses import dataclass

import torch
from torch import nn

from fecocodec.training.processes import average_gradients

LARGEST_GRADIENT = 1.0
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
        group["lr"] = learning_rate * group.get(SHARE, 1.0)
    if torch.isfinite(norm):
        optimiser.step()
    return float(norm)
