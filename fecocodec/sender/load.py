"""The sender from its weights file and back."""

from dataclasses import asdict
from pathlib import Path

from fecocodec.checkpoint import config_of, load_into, read_weights, serialise_weights
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.sender.model import Sender


def load_sender(path: Path, receiver: ReceiverConfig) -> Sender:
    """Sender ready to encode for such a receiver; raises ModelError for a missing, damaged or foreign file."""
    weights = read_weights(path)
    sender = Sender(config_of(weights, "sender", SenderConfig(), path), receiver)
    load_into(sender, weights.tensors, path)
    return sender.eval().requires_grad_(False)


def serialise_sender(sender: Sender) -> bytes:
    """Bytes of the sender's weights file, fp16."""
    return serialise_weights(dict(sender.state_dict()), {"sender": asdict(sender.config)})
