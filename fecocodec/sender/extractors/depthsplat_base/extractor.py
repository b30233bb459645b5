"""DepthSplat-Base as a frozen extractor of the adapter: posed photographs -> features at full resolution."""

import hashlib

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_base.depth import Depth, DepthPredictor
from fecocodec.sender.extractors.depthsplat_base.dpt_head import DptHead
from fecocodec.sender.extractors.depthsplat_small.branches import require_multiples

CHANNELS = 96
SIDE_MULTIPLE = 16  # pixels


class DepthSplatBase(nn.Module):
    """The branches of the depth predictor -> DPT head. A `LargeExtractor` without weights, until they are loaded.

    The features need no depth: `depth` is that of the public network, which is loaded as a whole.
    """

    def __init__(self) -> None:
        super().__init__()
        with torch.device("meta"):
            self.depth_predictor, self.feature_upsampler = DepthPredictor(), DptHead(CHANNELS)
        self.eval().requires_grad_(False)

    def num_channels(self) -> int:
        return CHANNELS

    @torch.no_grad()
    def features(
        self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras
    ) -> Float[Tensor, "batch view 96 h w"]:
        """Return the features. Raises ModelError without weights, InputError if a side is not a multiple of 16."""
        self._prepare(images)
        maps = self.depth_predictor.maps(images, cameras)
        found: Tensor = self.feature_upsampler(maps.monocular, maps.appearance, maps.multi_view)
        return found.unflatten(0, images.shape[:2])

    @torch.no_grad()
    def depth(self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> Depth:
        """Return the depth of every view. Arguments and errors as for `features`."""
        self._prepare(images)
        return self.depth_predictor.depth(self.depth_predictor.maps(images, cameras), cameras)

    def fingerprint(self) -> str:
        """Return a digest of names and values of all tensors."""
        self._require_weights()
        digest = hashlib.sha256()
        for name, value in sorted(self.state_dict().items()):
            digest.update(name.encode() + value.cpu().contiguous().numpy().tobytes())
        return f"depthsplat-base-{digest.hexdigest()[:16]}"

    def _prepare(self, images: Tensor) -> None:
        self._require_weights()
        require_multiples(images, SIDE_MULTIPLE)
        self.to(images.device)

    def _require_weights(self) -> None:
        if next(self.parameters()).is_meta:
            raise ModelError("depthsplat-base: it has no weights yet; load its checkpoint by `load_frozen_extractor`.")
