"""Batches of scenes, and what one training pass computes for them."""

from dataclasses import dataclass, replace
from typing import Any

from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.splatting.emission import Prediction


@dataclass(frozen=True)
class Batch:
    """Scenes with equally many views of one size. The first `num_context` views are coded, the others are targets.

    images: sRGB in [0, 1]. cameras: in the normalised frame of each scene. depth: in units of near, exact for
    procedural scenes, NaN for photographs. skipped: one sentence for each scene that was drawn and could not be used.
    """

    images: Float[Tensor, "batch view 3 h w"]
    cameras: Cameras
    depth: Float[Tensor, "batch view h w"]
    num_context: int
    lambda_q: Int[Tensor, " batch"]
    skipped: tuple[str, ...] = ()

    def to(self, device: str) -> "Batch":
        """Return the batch on a device."""
        images, depth, lambda_q = (
            tensor.to(device, non_blocking=True) for tensor in (self.images, self.depth, self.lambda_q)
        )
        return replace(self, images=images, cameras=self.cameras.to(device), depth=depth, lambda_q=lambda_q)


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
    renderings: tuple[Rendering, ...]  # one per scene, all its views
    estimated_bits: Float[Tensor, " batch"]
    lambda_q: Int[Tensor, " batch"]
