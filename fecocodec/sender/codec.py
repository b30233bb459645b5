"""The codec as a whole: the sender's and the receiver's networks, loaded from one model folder."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.sender.load import load_sender
from fecocodec.sender.model import Sender


@dataclass(frozen=True)
class Codec:
    """The networks of both ends on one device. model_id: of the receiver, as streams carry it."""

    sender: Sender
    receiver: Receiver
    model_id: bytes

    @property
    def device(self) -> torch.device:
        """Where the networks run."""
        return next(self.receiver.parameters()).device


@lru_cache(maxsize=2)
@torch.inference_mode(False)
def load_codec(folder: Path, device: str) -> Codec:
    """Load both networks of a model folder. Raises ModelError where a file is missing, damaged or does not match."""
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = load_sender(folder / SENDER_FILE, receiver.config, model_id)
    for network in (sender, receiver):
        to_channels_last(network, device)
    return Codec(sender, receiver, model_id)
