"""Entropy models and latents for tests, from numpy's generator, because torch's depends on the vector width."""

import numpy as np
import torch
from torch import Tensor

from fecocodec.coding.fixed_point import FixedPointLinear
from fecocodec.coding.priors import LatentPrior


def lively_prior(seed: int = 0) -> LatentPrior:
    """Return an entropy model with random weights and widely varying means and table indices."""
    rng = np.random.default_rng(seed)
    prior = LatentPrior()
    for name, layer in prior.named_modules():
        if isinstance(layer, FixedPointLinear):
            spread = 3.0 if name.endswith("leave") or name == "hyper_prior" else 1.4
            scale = spread / layer.weight.shape[1] ** 0.5
            layer.weight.data = torch.from_numpy(rng.normal(size=tuple(layer.weight.shape)) * scale).float()
            layer.bias.data = torch.from_numpy(rng.normal(size=tuple(layer.bias.shape)) * 0.3).float()
    return prior


def smooth_latents(views: int, height_8: int, width_8: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Return y and z of moderate variance; y is spatially correlated."""
    rng = np.random.default_rng(seed)
    coarse = rng.normal(size=(views, 32, height_8 // 4, width_8 // 4)) * 2.0
    y = coarse.repeat(4, axis=2).repeat(4, axis=3) + rng.normal(size=(views, 32, height_8, width_8)) * 0.5
    z = rng.normal(size=(views, 16, height_8 // 4, width_8 // 4)) * 1.5
    return torch.from_numpy(y).float(), torch.from_numpy(z).float()
