"""The sender from its weights file and back."""

from dataclasses import asdict
from pathlib import Path

from fecocodec.checkpoint import load_into, read_weights, serialise_weights
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.errors import ModelError
from fecocodec.sender.model import Sender


def load_sender(path: Path, receiver: ReceiverConfig) -> Sender:
    """Sender ready to encode for such a receiver; raises ModelError for a missing, damaged or foreign file."""
    weights = read_weights(path)
    stored = weights.config.get("sender")
    if not isinstance(stored, dict):
        raise ModelError(f"{path}: holds no sender; name a sender's weights file.")
    try:
        config = SenderConfig(**{name: tuple(v) if isinstance(v, list) else v for name, v in stored.items()})
    except TypeError as error:
        raise ModelError(f"{path}: made by another version of the codec; install that version.") from error
    sender = Sender(config, receiver)
    load_into(sender, weights.tensors, path)
    return sender.eval().requires_grad_(False)


def serialise_sender(sender: Sender) -> bytes:
    """Bytes of the sender's weights file, fp16."""
    return serialise_weights(dict(sender.state_dict()), {"sender": asdict(sender.config)})
