"""Posed photographs of one scene."""

from dataclasses import dataclass, replace

from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


@dataclass(frozen=True)
class Views:
    """Images of one scene with their cameras.

    images: sRGB in [0, 1], all of one size, already composited on white if transparent. names: one per view, for
    messages (usually the file name). alpha: opacity in [0, 1]; None if no image has transparency. notes: one sentence
    for each step of reading that the user may not expect, such as cropping. ignored: pixels that a mask marks, which
    show what is not of the scene, such as a passer-by; None if there are no masks. remarks: one sentence for each
    choice of reading that is no reason to doubt the result.
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
