"""Batches of scenes: their shapes at about equal cost, and what one training pass computes for them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.limits import check_sizes, check_view_shares
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.splatting.emission import Prediction


@dataclass(frozen=True)
class BatchShape:
    """Numbers of scenes, context views and target views of a batch. size: (height, width) in pixels."""

    num_scenes: int
    num_context: int
    num_target: int
    size: tuple[int, int]


@dataclass(frozen=True)
class BatchShapes:
    """The shapes from which a run draws one for each batch.

    num_scenes: scenes in a batch of the usual shape, which has the first number of views and the first size. A batch of
    another shape has as many scenes as possible without exceeding the pixels of the usual shape.
    view_shares: pairs (number of context views, relative frequency); the frequencies need not sum to 1.
    num_target: target views of every scene. sizes: (height, width) in pixels, drawn uniformly among those for which at
    least one scene fits.

    Raises InputError if a value is out of range, or a number of views fits at no size.
    """

    num_scenes: int
    view_shares: tuple[tuple[int, float], ...]
    num_target: int
    sizes: tuple[tuple[int, int], ...]

    def __post_init__(self) -> None:
        if not self.view_shares or not self.sizes or self.num_scenes < 1 or self.num_target < 1:
            raise InputError("A batch has no scenes, no views, no targets or no size; give at least one of each.")
        check_view_shares(self.view_shares)
        check_sizes(self.sizes)
        for count, _ in self.view_shares:
            if not self._sizes_for(count):
                raise InputError(
                    f"{count} context views exceed the {self.most_pixels} pixels of a batch of the usual shape at "
                    "every size; give a smaller size too, fewer context views by `view_shares`, or more scenes."
                )

    @property
    def most_pixels(self) -> int:
        """Return the largest number of pixels of all views of a batch: that of the usual shape."""
        height, width = self.sizes[0]
        return self.num_scenes * (self.view_shares[0][0] + self.num_target) * height * width

    @property
    def usual(self) -> BatchShape:
        """Return the usual shape: the first number of views at the first size."""
        return BatchShape(self.num_scenes, self.view_shares[0][0], self.num_target, self.sizes[0])

    def draw(self, generator: torch.Generator) -> BatchShape:
        """Draw the shape of a batch. The generator is not used if there is no choice."""
        num_context = self._draw_views(generator)
        sizes = self._sizes_for(num_context)
        pick = int(torch.randint(len(sizes), (), generator=generator)) if len(sizes) > 1 else 0
        return BatchShape(self._scenes_of(num_context, sizes[pick]), num_context, self.num_target, sizes[pick])

    def _draw_views(self, generator: torch.Generator) -> int:
        if len(self.view_shares) == 1:
            return self.view_shares[0][0]
        shares = torch.tensor([share for _, share in self.view_shares])
        return self.view_shares[int(torch.multinomial(shares, 1, generator=generator))][0]

    def _sizes_for(self, num_context: int) -> list[tuple[int, int]]:
        return [size for size in self.sizes if self._scenes_of(num_context, size) > 0]

    def _scenes_of(self, num_context: int, size: tuple[int, int]) -> int:
        return self.most_pixels // ((num_context + self.num_target) * size[0] * size[1])


@dataclass(frozen=True)
class Batch:
    """Scenes with equally many views of one size. The first `num_context` views are coded, the others are targets.

    images: sRGB in [0, 1]. cameras: in the normalised frame of each scene. depth: in units of near, exact for
    synthetic scenes, NaN for photographs. skipped: one sentence for each scene that was drawn and could not be used.
    """

    images: Float[Tensor, "batch view 3 h w"]
    cameras: Cameras
    depth: Float[Tensor, "batch view h w"]
    num_context: int
    lambda_q: Int[Tensor, " batch"]
    skipped: tuple[str, ...] = ()

    @property
    def num_context_pixels(self) -> int:
        """Number of pixels of the context views of a scene."""
        return self.num_context * self.images.shape[-1] * self.images.shape[-2]

    def mapped(self, change: Callable[[Tensor], Tensor]) -> "Batch":
        """Return the batch with all its tensors changed."""
        cameras = Cameras(*map(change, self.cameras.fields()))
        images, depth, lambda_q = map(change, (self.images, self.depth, self.lambda_q))
        return replace(self, images=images, cameras=cameras, depth=depth, lambda_q=lambda_q)

    def to(self, device: str) -> "Batch":
        """Return the batch on a device, copied there without blocking if it is in pinned memory."""
        return self.mapped(lambda tensor: tensor.to(device, non_blocking=True))


@dataclass(frozen=True)
class MatchedDisparity:
    """Relative disparity at 1/4: trainable, aggregated by matching, and the cross-view consistency of the latter."""

    learned: Float[Tensor, "batch view h4 w4"]
    aggregated: Float[Tensor, "batch view h4 w4"]
    consistency: Float[Tensor, "batch view h4 w4"]


@dataclass(frozen=True)
class Extracted:
    """What the frozen parts of the extractor compute for a batch.

    matching: its result at the context views. features: F1, None while the fusion of the extractor is trained. matched:
    disparity for the loss.
    """

    matching: Any
    features: Float[Tensor, "item channel h4 w4"] | None
    matched: MatchedDisparity

    def half(self) -> "Extracted":
        """The same with features in half precision."""
        return self if self.features is None else replace(self, features=self.features.half())

    def float(self) -> "Extracted":
        """The same with features in single precision."""
        return self if self.features is None else replace(self, features=self.features.float())


@dataclass(frozen=True)
class StageOutcome:
    """Results of one stage of a training pass. lambda_q: quantised lambda of the stage."""

    prediction: Prediction
    renderings: tuple[Rendering, ...]  # one per scene, context views first
    estimated_bits: Float[Tensor, " batch"]
    lambda_q: Int[Tensor, " batch"]

    @property
    def images(self) -> Float[Tensor, "batch view 3 h w"]:
        """The colours of the renderings."""
        return torch.stack([rendering.color for rendering in self.renderings])
