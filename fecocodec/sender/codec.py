"""The complete codec: networks of the sender and of the receiver, loaded from one model folder."""

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
    """Networks of sender and receiver on one device. model_id: id of the receiver, as stored in streams."""

    sender: Sender
    receiver: Receiver
    model_id: bytes

    @property
    def device(self) -> torch.device:
        """Device of the networks."""
        return next(self.receiver.parameters()).device


@lru_cache(maxsize=2)
@torch.inference_mode(False)
def load_codec(folder: Path, device: str) -> Codec:
    """Load both networks of a model folder. device: "cpu", "cuda" or "cuda:N".

    Raises ModelError if a file is missing or damaged, or if the two files are of different models.
    """
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = load_sender(folder / SENDER_FILE, receiver.config, model_id)
    for network in (sender, receiver):
        to_channels_last(network, device)
    return Codec(sender, receiver, model_id)
