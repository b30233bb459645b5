"""Gradient steps that bring pictures of changed Gaussians back to what they were before the change.

After leaving Gaussians out, the rest can learn to stand for them within seconds, as in compression of optimised splats
(Fan et al., "LightGaussian: Unbounded 3D Gaussian Compression with 15x Reduction and 200+ FPS", 2023).
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import render

STEPS = 20
VIEWS_A_STEP = 5
STEP_OF_OPACITY = 0.07  # of its logit, in the first step; falls evenly towards zero
STEP_OF_SCALE_AND_COLOUR = 0.028  # of the scales' logarithms, and of all harmonics
_BETAS = (0.8, 0.95)  # Adam's, for few steps
_MOST_OPAQUE, _LEAST_OPAQUE = 1.0 - 1e-4, 1e-4


@torch.enable_grad()
def mended(gaussians: Gaussians, cameras: Cameras, pictures: Float[Tensor, "camera 3 height width"]) -> Gaussians:
    """The Gaussians with opacities, scales and harmonics moved so that these cameras see about these pictures.

    Places, rotations, number and order stay. Every step looks at VIEWS_A_STEP of the cameras, in turn.
    """
    opacity = gaussians.opacities.clamp(_LEAST_OPAQUE, _MOST_OPAQUE).logit()
    starts = (opacity, gaussians.scales.log(), gaussians.harmonics)
    logits, log_scales, harmonics = moved = [start.detach().clone().requires_grad_() for start in starts]
    lengths = (STEP_OF_OPACITY, STEP_OF_SCALE_AND_COLOUR, STEP_OF_SCALE_AND_COLOUR)
    groups = [{"params": [field], "lr": length} for field, length in zip(moved, lengths, strict=True)]
    optimiser = torch.optim.Adam(groups, betas=_BETAS)
    fall = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 1.0 / STEPS, total_iters=STEPS - 1)
    size = (pictures.shape[-2], pictures.shape[-1])
    views = min(VIEWS_A_STEP, cameras.num_views)
    for step in range(STEPS):
        seen = [(step * views + view) % cameras.num_views for view in range(views)]
        color = render(_with(gaussians, logits, log_scales, harmonics), cameras.select(seen), size).color
        optimiser.zero_grad()
        (color - pictures[seen]).square().mean().backward()
        optimiser.step()
        fall.step()
    return _with(gaussians, *(field.detach() for field in moved))


def _with(gaussians: Gaussians, logits: Tensor, log_scales: Tensor, harmonics: Tensor) -> Gaussians:
    return replace(gaussians, opacities=logits.sigmoid(), scales=log_scales.exp(), harmonics=harmonics)
