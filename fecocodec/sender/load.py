"""The sender from its weights file and back."""

from dataclasses import asdict
from pathlib import Path

from fecocodec.checkpoint import Weights, config_of, load_into, read_weights, serialise_weights
from fecocodec.config import AdaptedSenderConfig, CodecConfig, PaperSenderConfig, ReceiverConfig, SenderConfig
from fecocodec.errors import ModelError
from fecocodec.sender.model import Sender

RECEIVER_ID = "receiver_model_id"
EXTRACTOR = "extractor"
_CONFIGS: tuple[CodecConfig, ...] = (SenderConfig(), PaperSenderConfig(), AdaptedSenderConfig())


def load_sender(path: Path, receiver: ReceiverConfig, model_id: bytes) -> Sender:
    """Sender ready to encode for the receiver of this model id and these sizes.

    Raises ModelError for a missing, damaged or foreign file, and for one that was trained with another receiver.
    """
    weights = read_weights(path)
    config = config_of(weights, "sender", _config_like(weights, path), path)
    require_receiver(weights, model_id, path)
    sender = Sender(config, receiver)
    load_into(sender, weights.tensors, path)
    return sender.eval().requires_grad_(False)


def require_receiver(weights: Weights, model_id: bytes, path: Path) -> None:
    """Raises ModelError where a sender's file was made for another receiver."""
    if weights.config.get(RECEIVER_ID) != model_id.hex():
        raise ModelError(
            f"{path}: this sender was made for the receiver {weights.config.get(RECEIVER_ID)}, the one beside it is "
            f"{model_id.hex()}; put the two files of one model together."
        )


def serialise_sender(sender: Sender, model_id: bytes) -> bytes:
    """Bytes of the sender's weights file, fp16. model_id: of the receiver it was trained with."""
    config = sender.config
    described = {"sender": asdict(config), EXTRACTOR: config.extractor, RECEIVER_ID: model_id.hex()}
    return serialise_weights(dict(sender.state_dict()), described)


def _config_like(weights: Weights, path: Path) -> CodecConfig:
    """A configuration of the class that the file's extractor has; files of before there were two are compact."""
    name = weights.config.get(EXTRACTOR, SenderConfig.extractor)
    for config in _CONFIGS:
        if config.extractor == name:
            return config
    raise ModelError(f"{path}: its extractor {name!r} is not known to this version; install the one that made it.")
