"""Training samples: context views, target views, and depth where it is known."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Sample:
    """One training example.

    views: the context views first, then the target views; one set of near and far for all.
    num_context: how many of the views are context.
    depth: z along the optical axis in scene units at pixel centres, exact; None for photographs.
    skipped: one sentence for each scene that was drawn before this one and could not be used.
    """

    views: Views
    num_context: int
    depth: Float[Tensor, "view height width"] | None
    skipped: tuple[str, ...] = ()


@runtime_checkable
class SampleSource(Protocol):
    """A source of training samples."""

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw one scene; size: (height, width) in pixels. Equal generator states give equal samples."""


def contact_sheet(samples: list[Sample]) -> Float[Tensor, "3 rows columns"]:
    """Return one row per sample: its views, then, if known, their disparity (bright is near). All have one size."""
    return torch.cat([_sheet_row(sample) for sample in samples], dim=1)


def _sheet_row(sample: Sample) -> Float[Tensor, "3 height columns"]:
    tiles = sample.views.images
    if sample.depth is not None:
        cameras = sample.views.cameras
        relative = (1 / sample.depth - 1 / cameras.far) / (1 / cameras.near - 1 / cameras.far)
        tiles = torch.cat((tiles, relative.clamp(0, 1)[:, None].expand(-1, 3, -1, -1)))
    return rearrange(tiles, "view rgb height width -> rgb height (view width)")
