"""Refit Gaussians to given images by gradient steps, as after pruning.

Fan et al., "LightGaussian: Unbounded 3D Gaussian Compression with 15x Reduction and 200+ FPS", 2023, recover the
quality of pruned splats in the same way.
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import render

STEPS = 20
VIEWS_PER_STEP = 5
STEP_OF_OPACITY = 0.07  # learning rate of opacity logits in the first step; falls linearly towards zero
STEP_OF_SCALE_AND_COLOUR = 0.028  # likewise, of log scales and of harmonics
_BETAS = (0.8, 0.95)  # of Adam; short memory, because the steps are few
_MOST_OPAQUE, _LEAST_OPAQUE = 1.0 - 1e-4, 1e-4


@torch.enable_grad()
def refit(gaussians: Gaussians, cameras: Cameras, images: Float[Tensor, "camera 3 height width"]) -> Gaussians:
    """Optimise opacities, scales and harmonics so that renderings at these cameras approach these images (sRGB).

    Means, rotations, number and order do not change. Each step renders VIEWS_PER_STEP of the cameras, in turn.
    """
    opacity = gaussians.opacities.clamp(_LEAST_OPAQUE, _MOST_OPAQUE).logit()
    starts = (opacity, gaussians.scales.log(), gaussians.harmonics)
    logits, log_scales, harmonics = optimised = [start.detach().clone().requires_grad_() for start in starts]
    lengths = (STEP_OF_OPACITY, STEP_OF_SCALE_AND_COLOUR, STEP_OF_SCALE_AND_COLOUR)
    groups = [{"params": [field], "lr": length} for field, length in zip(optimised, lengths, strict=True)]
    optimiser = torch.optim.Adam(groups, betas=_BETAS)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 1.0 / STEPS, total_iters=STEPS - 1)
    size = (images.shape[-2], images.shape[-1])
    views = min(VIEWS_PER_STEP, cameras.num_views)
    for step in range(STEPS):
        rendered = [(step * views + view) % cameras.num_views for view in range(views)]
        color = render(_with(gaussians, logits, log_scales, harmonics), cameras.select(rendered), size).color
        optimiser.zero_grad()
        (color - images[rendered]).square().mean().backward()
        optimiser.step()
        schedule.step()
    return _with(gaussians, *(field.detach() for field in optimised))


def _with(gaussians: Gaussians, logits: Tensor, log_scales: Tensor, harmonics: Tensor) -> Gaussians:
    return replace(gaussians, opacities=logits.sigmoid(), scales=log_scales.exp(), harmonics=harmonics)
