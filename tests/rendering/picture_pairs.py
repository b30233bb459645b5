"""Pairs of pictures from the bundled example, for the perceptual metrics."""

from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.captures.scene_folder import read_views

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "motorcycle"

Picture = Float[Tensor, "1 3 height width"]


def picture_pairs() -> dict[str, tuple[Picture, Picture]]:
    """Return pairs (picture, changed picture) by the name of the change: sRGB in [0, 1], two sizes."""
    left, right = read_views(EXAMPLE, size=(128, 160)).images[:2].split(1)
    small = F.interpolate(left, scale_factor=0.25, mode="bilinear", antialias=True)
    noise = torch.randn(left.shape, generator=torch.Generator().manual_seed(0))
    return {
        "other camera": (left, right),
        "blurred": (left, F.interpolate(small, size=left.shape[-2:], mode="bilinear").clamp(0, 1)),
        "noisy": (left, (left + 0.05 * noise).clamp(0, 1)),
        "moved by two pixels": (left[..., :-2], left[..., 2:]),
        "darker, small": (left[..., :40, :33], 0.6 * left[..., :40, :33]),
    }
