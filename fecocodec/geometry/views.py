"""Posed photographs of one scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


@dataclass(frozen=True)
class Views:
    """Images of one scene with their cameras.

    images: sRGB in [0, 1], all of one size, already composited on white if transparent. names: one per view, for
    messages (usually the file name). alpha: opacity in [0, 1]; None if no image has transparency. notes: one sentence
    for each step of reading that the user may not expect, such as cropping. ignored: pixels that a mask marks, which
    show what is not of the scene, such as a passer-by, and are left out of everything; None if there are no masks.
    remarks: one sentence for each choice of reading that is no reason to doubt the result.
    """

    images: Float[Tensor, "view 3 height width"]
    cameras: Cameras
    names: tuple[str, ...]
    alpha: Float[Tensor, "view height width"] | None = None
    notes: tuple[str, ...] = ()
    ignored: Bool[Tensor, "view height width"] | None = None
    remarks: tuple[str, ...] = ()

    @property
    def image_size(self) -> tuple[int, int]:
        """Return (height, width) in pixels."""
        return self.images.shape[-2], self.images.shape[-1]

    def outside_masks(self, renderings: Float[Tensor, "view 3 height width"]) -> Float[Tensor, "view 3 height width"]:
        """Return renderings of the views, equal to `images` where a mask marks pixels, which then do not count."""
        return renderings if self.ignored is None else torch.where(self.ignored[:, None], self.images, renderings)

    def within(self, near: float, far: float) -> "Views":
        """Return the views with these bounds of depth, in scene units."""
        bounds = {"near": torch.tensor(near, dtype=torch.float32), "far": torch.tensor(far, dtype=torch.float32)}
        return replace(self, cameras=replace(self.cameras, **bounds))

    def select(self, views: list[int]) -> "Views":
        """Return these views, in this order."""
        return replace(
            self,
            images=self.images[views],
            cameras=self.cameras.select(views),
            names=tuple(self.names[view] for view in views),
            alpha=None if self.alpha is None else self.alpha[views],
            ignored=None if self.ignored is None else self.ignored[views],
        )


def joined(parts: Sequence[Views]) -> Views:
    """Return the views of all parts, which have one image size, in their order. near, far, notes: of the first part."""
    return Views(
        images=torch.cat([part.images for part in parts]),
        cameras=reduce(Cameras.joined, (part.cameras for part in parts)),
        names=tuple(name for part in parts for name in part.names),
        alpha=joined_planes([(part.alpha, torch.ones_like(part.images[:, 0])) for part in parts]),
        notes=parts[0].notes,
        ignored=joined_masks([(part.ignored, part.images) for part in parts]),
    )


def with_cameras(parts: Sequence[Views], cameras: Cameras) -> list[Views]:
    """Return the parts with these cameras, which are those of all parts in their order."""
    sizes = [len(part.images) for part in parts]
    split = zip(cameras.extrinsics.split(sizes), cameras.intrinsics.split(sizes), strict=True)
    return [
        replace(part, cameras=replace(part.cameras, extrinsics=extrinsics, intrinsics=intrinsics))
        for part, (extrinsics, intrinsics) in zip(parts, split, strict=True)
    ]


def joined_masks(
    parts: Sequence[tuple[Bool[Tensor, "_ h w"] | None, Float[Tensor, "_ 3 h w"]]],
) -> Bool[Tensor, "view h w"] | None:
    """Return the ignored pixels of all parts, given those of each, and its images; None if no part has any."""
    return joined_planes([(ignored, torch.zeros_like(images[:, 0], dtype=torch.bool)) for ignored, images in parts])


def joined_planes(parts: Sequence[tuple[Tensor | None, Tensor]]) -> Tensor | None:
    """Return the planes of all parts, the second of a pair where there is no first; None if no part has a first."""
    if all(plane is None for plane, _ in parts):
        return None
    return torch.cat([usual if plane is None else plane for plane, usual in parts])
