"""Posed photographs of one scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


@dataclass(frozen=True)
class Views:
    """Images of one scene with their cameras.

    images: sRGB in [0, 1], all of one size, already composited on white if transparent. names: one per view, for
    messages (usually the file name). alpha: opacity in [0, 1]; None if no image has transparency. notes: one sentence
    for each step of reading that the user may not expect, such as cropping.
    """

    images: Float[Tensor, "view 3 height width"]
    cameras: Cameras
    names: tuple[str, ...]
    alpha: Float[Tensor, "view height width"] | None = None
    notes: tuple[str, ...] = ()

    @property
    def image_size(self) -> tuple[int, int]:
        """Return (height, width) in pixels."""
        return self.images.shape[-2], self.images.shape[-1]

    def select(self, views: list[int]) -> "Views":
        """Return these views, in this order."""
        return replace(
            self,
            images=self.images[views],
            cameras=self.cameras.select(views),
            names=tuple(self.names[view] for view in views),
            alpha=None if self.alpha is None else self.alpha[views],
        )


def joined(parts: Sequence[Views]) -> Views:
    """Return the views of all parts, which have one image size, in their order. near, far, notes: of the first part."""
    first = parts[0]
    opaque = [torch.ones(len(part.images), *part.image_size) for part in parts]
    alphas = [full if part.alpha is None else part.alpha for part, full in zip(parts, opaque, strict=True)]
    return Views(
        images=torch.cat([part.images for part in parts]),
        cameras=reduce(Cameras.joined, (part.cameras for part in parts)),
        names=tuple(name for part in parts for name in part.names),
        alpha=None if all(part.alpha is None for part in parts) else torch.cat(alphas),
        notes=first.notes,
    )
