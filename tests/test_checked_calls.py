"""Calls of the library with tensors of wrong shapes fail in tests, also after calls with right ones."""

import pytest
import torch
from jaxtyping import TypeCheckError

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.metrics import psnr


def test_wrong_shapes_are_found_after_right_ones() -> None:
    images, zeros = torch.rand(2, 3, 8, 8), torch.zeros
    for _ in range(2):
        psnr(images, images)
        Gaussians(zeros(4, 3), zeros(4, 3), zeros(4, 4), zeros(4), zeros(4, 1, 3))
    with pytest.raises(TypeCheckError):
        psnr(images, images[0, 0])
    with pytest.raises(TypeCheckError):
        Gaussians(zeros(4, 3), zeros(4, 3), zeros(5, 4), zeros(4), zeros(4, 1, 3))
