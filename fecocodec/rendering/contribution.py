"""Contribution of each Gaussian to rendered images."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.rendering.rasterizer import render


def contributions(
    gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int]
) -> Float[Tensor, "view gaussian"]:
    """Return, per camera, the sum over pixels of the blending weight (alpha times transmittance) of each Gaussian.

    The unit is the pixel: the sum over Gaussians is the accumulated opacity of the image. A pixel is the weighted sum
    of the Gaussians' colours, so the weights are the derivative of the sum of all pixels with respect to each colour;
    this takes one backward pass per camera. image_size: (height, width).
    """
    views = [_weights(gaussians, cameras.select([view]), image_size) for view in range(cameras.num_views)]
    return torch.stack(views)


@torch.inference_mode(False)
@torch.enable_grad()
def _weights(gaussians: Gaussians, camera: Cameras, image_size: tuple[int, int]) -> Float[Tensor, " gaussian"]:
    # Copies, because tensors made in inference mode have no gradients. Harmonics of 0 are mid-grey, where the clamp at
    # colour 0 is not active.
    fields = Gaussians(*(field.detach().clone() for field in gaussians.fields()))
    harmonics = torch.zeros_like(fields.harmonics[:, :1]).requires_grad_()
    color = render(replace(fields, harmonics=harmonics), _copied(camera), image_size).color
    (gradient,) = torch.autograd.grad(color[:, 0].sum(), harmonics)
    return gradient[:, 0, 0] / SH_DEGREE_0


def _copied(camera: Cameras) -> Cameras:
    return Cameras(*(field.clone() for field in camera.fields()))
