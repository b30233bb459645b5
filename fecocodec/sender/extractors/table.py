"""All feature extractors that weights files can name. A new one is a file beside this one, and a line here."""

from collections.abc import Callable
from typing import Any

from torch import nn

from fecocodec.config import AdaptedSenderConfig, CodecConfig, PaperSenderConfig, SenderConfig
from fecocodec.errors import ModelError
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

Build = Callable[[Any, int], nn.Module]  # (configuration, channels of F1) -> an `Extractor`


def _depthsplat_small(config: PaperSenderConfig, channels: int) -> nn.Module:
    return DepthSplatSmall(config.geometry, config.matching_scale)


def _adapted(config: AdaptedSenderConfig, channels: int) -> nn.Module:
    raise ModelError(f"extractor {config.extractor}: its own network is needed too; use `load_adapted_sender`.")


EXTRACTORS: dict[type[CodecConfig], Build] = {
    SenderConfig: CompactExtractor,
    PaperSenderConfig: _depthsplat_small,
    AdaptedSenderConfig: _adapted,
}


def config_named(name: object) -> CodecConfig | None:
    """Return the default configuration of the sender with the extractor of this name; None if there is none."""
    return next((kind() for kind in EXTRACTORS if kind.extractor == name), None)
