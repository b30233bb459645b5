"""DepthSplat-Base as a frozen extractor of the adapter: posed photographs -> features at full resolution."""

import hashlib

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_base.depth import DepthPredictor, Maps
from fecocodec.sender.extractors.depthsplat_base.dpt_head import DptHead
from fecocodec.sender.extractors.depthsplat_small.extractor import require_whole

CHANNELS = 96


class DepthSplatBase(nn.Module):
    """The branches of the depth predictor -> DPT head. A `LargeExtractor` without weights, until they are loaded.

    The features need no depth; the public network is kept as a whole.
    """

    def __init__(self) -> None:
        super().__init__()
        self.arrange(4)

    def arrange(self, lowest: int) -> None:
        """Build the networks without weights. lowest: 4 for matching at 1/4 and 1/2 resolution; 8 for 1/8 and 1/4, as
        in the published checkpoints that saw DL3DV."""
        with torch.device("meta"):
            self.depth_predictor, self.feature_upsampler = DepthPredictor(lowest), DptHead(CHANNELS, lowest)
        self.eval().requires_grad_(False)

    def num_channels(self) -> int:
        return CHANNELS

    def maps(self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> Maps:
        """Run the branches. Raises ModelError without weights, InputError for sides that they cannot divide."""
        if self.feature_upsampler.projects[0].weight.is_meta:
            raise ModelError("depthsplat-base: it has no weights yet; load its checkpoint by `load_frozen_extractor`.")
        require_whole(images, 4 * self.depth_predictor.lowest)
        return self.to(images.device).depth_predictor.maps(images, cameras)

    def features(
        self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras
    ) -> Float[Tensor, "batch view 96 h w"]:
        maps = self.maps(images, cameras)
        found: Tensor = self.feature_upsampler(maps.monocular, maps.appearance, maps.multi_view)
        return found.unflatten(0, images.shape[:2])

    def fingerprint(self) -> str:
        """Return a digest of the names and values of all tensors."""
        digest = hashlib.sha256()
        for name, value in sorted(self.state_dict().items()):
            digest.update(name.encode() + value.cpu().contiguous().numpy().tobytes())
        return f"depthsplat-base-{digest.hexdigest()[:16]}"
