"""Networks of the sender. Encoding also needs the networks of the receiver, for S1 and G1."""

from typing import Any

from torch import nn

from fecocodec.config import NO_CONTEXT, NO_FEEDBACK, CodecConfig, ReceiverConfig
from fecocodec.errors import ModelError
from fecocodec.sender.analysis import Analysis, HyperAnalysis
from fecocodec.sender.extractors.adapter import AdaptedExtractor
from fecocodec.sender.extractors.table import EXTRACTORS
from fecocodec.sender.feedback import FeedbackExtractor, PictureFeedbackExtractor
from fecocodec.sender.step_network import StepNetwork


class Sender(nn.Module):
    """E_mv, E_fb, g_a and h_a. g_a and h_a are shared by both stages; E_mv depends on the profile.

    steps: proposes the steps of latent optimisation; None for steps along the gradient. sharp_steps: proposes steps
    towards sharper pictures; None if there are none.
    """

    def __init__(
        self, config: CodecConfig, receiver: ReceiverConfig, extractor: AdaptedExtractor | None = None
    ) -> None:
        """extractor: third-party extractor, see `adapted_sender`; None for the one that the configuration describes.

        Raises ModelError for an unknown extractor or ablation.
        """
        super().__init__()
        if config.ablation not in ("", NO_CONTEXT, NO_FEEDBACK):
            raise ModelError(f"There is no ablation '{config.ablation}'; choose {NO_CONTEXT} or {NO_FEEDBACK}.")
        self.config = config
        # An `Extractor`; Any, because calling a module has no type.
        self.extractor: Any = extractor or EXTRACTORS[type(config)](config, receiver.state_channels)
        feedback = FeedbackExtractor if receiver.kind.has_depth_feedback else PictureFeedbackExtractor
        self.feedback = feedback(config, receiver)
        self.analysis = Analysis(config, receiver)
        self.hyper_analysis = HyperAnalysis(receiver)
        self.steps = _step_network(config, receiver)
        self.sharp_steps = _step_network(config, receiver) if config.has_sharp_steps else None


def _step_network(config: CodecConfig, receiver: ReceiverConfig) -> StepNetwork | None:
    if not config.step_channels:
        return None
    return StepNetwork(receiver.latent_channels, receiver.state_channels, config.step_channels)
