"""Adding a feature extractor takes one class and one line of the table: files of it load, encode and train."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.config import CodecConfig, ReceiverConfig
from fecocodec.container import read_stream
from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import load_codec, serialise_sender
from fecocodec.sender.encode import encode
from fecocodec.sender.extractors.protocol import Extractor, MatchedDepth, Matching
from fecocodec.sender.model import EXTRACTORS, Sender
from fecocodec.sender.scene import Guides
from tests.example_scenes import example_views


@dataclass(frozen=True)
class PixelConfig(CodecConfig):
    extractor: ClassVar[str] = "pixels"
    width: int = 24


class PixelExtractor(nn.Module):
    """Pixels, without depth."""

    is_conditioned = False

    def __init__(self, config: PixelConfig, channels: int) -> None:
        super().__init__()
        self.input, self.output = nn.Conv2d(48, config.width, 1), nn.Conv2d(config.width, channels, 1)

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        return ()

    def match(
        self, images: Tensor, cameras: Cameras, guides: Guides | None = None, ignored: Tensor | None = None
    ) -> Matching:
        height, width = (side // 4 for side in images.shape[-2:])
        disparity = images.new_full((images.shape[0] * images.shape[1], 1, height, width), 0.5)
        return Matching(disparity, MatchedDepth(disparity, torch.zeros_like(disparity)))

    def fuse(self, images: Tensor, matching: Matching, condition: RateCondition | None = None) -> Tensor:
        pixels = F.pixel_unshuffle(rearrange(images, "b v c h w -> (b v) c h w"), 4)
        features: Tensor = self.output(self.input(pixels).relu())
        return features


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A model with random weights and this extractor."""
    monkeypatch.setitem(EXTRACTORS, PixelConfig, PixelExtractor)
    torch.manual_seed(0)
    config = ReceiverConfig()
    receiver, sender = Receiver(config), Sender(PixelConfig(width=16), config)
    weights = serialise_receiver(receiver)
    (tmp_path / RECEIVER_FILE).write_bytes(weights)
    (tmp_path / SENDER_FILE).write_bytes(serialise_sender(sender, model_id_of(weights)))
    return tmp_path


def test_a_new_extractor_loads_encodes_and_gets_gradients(folder: Path) -> None:
    extractor = load_codec(folder, "cpu").sender.extractor
    assert isinstance(extractor, Extractor) and extractor.input.out_channels == 16
    views = example_views(2)
    assert isinstance(extractor.match(views.images[None], views.cameras.as_batch()), Matching)
    assert read_stream(encode(views, model=folder, effort="fast")).header.num_stages == 2
    views, sender = example_views(2), load_codec(folder, "cpu").sender
    for parameter in sender.extractor.parameters():
        parameter.requires_grad_(True)
    images = views.images[None]
    sender.extractor.fuse(images, sender.extractor.match(images, views.cameras.as_batch())).sum().backward()
    assert all(parameter.grad is not None for parameter in sender.extractor.parameters())
