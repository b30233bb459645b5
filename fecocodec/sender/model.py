"""The sender's own networks; it also needs the receiver's, because it must know S1 and G1."""

from torch import nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.sender.analysis import Analysis, HyperAnalysis
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.feedback import FeedbackExtractor


class Sender(nn.Module):
    """E_mv, E_fb, g_a and h_a of the compact profile; g_a and h_a are shared by the two stages."""

    def __init__(self, config: SenderConfig, receiver: ReceiverConfig) -> None:
        super().__init__()
        self.config = config
        self.extractor = CompactExtractor(config, receiver.state_channels)
        self.feedback = FeedbackExtractor(config, receiver)
        self.analysis = Analysis(config, receiver)
        self.hyper_analysis = HyperAnalysis(receiver)
