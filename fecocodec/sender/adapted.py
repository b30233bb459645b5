"""Senders with a third-party extractor: construction, and loading from their weights file.

The file (`serialise_sender`) holds the adapter and the sender's half of the codec, and the fingerprint of the
extractor they were trained with.
"""

from pathlib import Path

from fecocodec.checkpoint import config_of, load_into, read_weights
from fecocodec.config import AdaptedSenderConfig, ReceiverConfig
from fecocodec.errors import ModelError
from fecocodec.sender.extractors.adapter import AdaptedExtractor, LargeExtractor
from fecocodec.sender.load import require_receiver
from fecocodec.sender.model import Sender


def adapted_sender(extractor: LargeExtractor, receiver: ReceiverConfig) -> Sender:
    """An untrained sender around the extractor, for a receiver of these sizes; begin with `adopt_codec`."""
    config = AdaptedSenderConfig(fingerprint=extractor.fingerprint(), extractor_channels=extractor.num_channels())
    return Sender(config, receiver, AdaptedExtractor(extractor, receiver.state_channels))


def load_adapted_sender(path: Path, extractor: LargeExtractor, receiver: ReceiverConfig, model_id: bytes) -> Sender:
    """Sender ready to encode, as `load_sender`; raises ModelError also where it was trained with another extractor."""
    weights = read_weights(path)
    config = config_of(weights, "sender", AdaptedSenderConfig(), path)
    require_receiver(weights, model_id, path)
    if config.fingerprint != extractor.fingerprint():
        raise ModelError(
            f"{path}: was trained with the extractor {config.fingerprint}, not {extractor.fingerprint()}; load that."
        )
    sender = adapted_sender(extractor, receiver)
    load_into(sender, weights.tensors, path)
    return sender.eval().requires_grad_(False)


def adopt_codec(sender: Sender, trained: Sender) -> None:
    """Copy g_a, h_a and E_fb of a trained sender into one with another extractor; the extractor stays as it is.

    With a receiver that stays frozen, files of both senders then decode with the same receiver.
    Raises ModelError where the two have other sizes.
    """
    for name in ("analysis", "hyper_analysis", "feedback"):
        tensors = getattr(trained, name).state_dict()
        load_into(getattr(sender, name), tensors, Path(f"the trained sender's {name}"))
