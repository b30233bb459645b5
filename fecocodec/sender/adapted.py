"""Construct and load senders with a third-party extractor.

Their weights file (see `serialise_sender`) contains the adapter, the other networks of the sender, and the fingerprint
of the extractor that they were trained with. It does not contain the weights of the extractor.
"""

from dataclasses import replace
from pathlib import Path

from fecocodec.checkpoint import config_of, load_into, read_weights
from fecocodec.config import CODEC_CHANNELS, PAPER, AdaptedSenderConfig, ReceiverConfig
from fecocodec.errors import ModelError
from fecocodec.sender.codec import require_receiver
from fecocodec.sender.extractors.adapter import AdaptedExtractor, ConditionedAdapter, LargeExtractor
from fecocodec.sender.model import Sender


def adapted_sender(extractor: LargeExtractor, receiver: ReceiverConfig) -> Sender:
    """Return an untrained sender with this extractor, for a receiver with this configuration.

    Call `adopt_codec` before training to start from a trained codec. With the method "paper", the blocks of the adapter
    are conditioned on lambda, and g_a has the paper's width.
    """
    width = CODEC_CHANNELS if receiver.method == PAPER else AdaptedSenderConfig.analysis_channels
    return _built(AdaptedSenderConfig(width), extractor, receiver)


def _built(config: AdaptedSenderConfig, extractor: LargeExtractor, receiver: ReceiverConfig) -> Sender:
    """Return an untrained sender with these widths and this extractor."""
    config = replace(config, fingerprint=extractor.fingerprint(), extractor_channels=extractor.num_channels())
    adapter = ConditionedAdapter if receiver.kind.has_conditioned_adapter else AdaptedExtractor
    return Sender(config, receiver, adapter(extractor, receiver.state_channels))


def load_adapted_sender(path: Path, extractor: LargeExtractor, receiver: ReceiverConfig, model_id: bytes) -> Sender:
    """Load a sender with a third-party extractor for encoding; arguments as for `load_sender`.

    Raises ModelError as `load_sender` does, and if the sender was trained with another extractor.
    """
    weights = read_weights(path)
    config = config_of(weights, "sender", AdaptedSenderConfig(), path)
    require_receiver(weights, model_id, path)
    if config.fingerprint != extractor.fingerprint():
        raise ModelError(
            f"{path}: was trained with the extractor {config.fingerprint}, not {extractor.fingerprint()}; load that."
        )
    sender = _built(config, extractor, receiver)
    load_into(sender, weights.tensors, path)
    return sender.eval().requires_grad_(False)


def adopt_codec(sender: Sender, trained: Sender) -> None:
    """Copy g_a, h_a and E_fb from `trained` to `sender`, which has another extractor. The extractor is not changed.

    If the receiver is frozen during training, the same receiver decodes the streams of both senders.
    Raises ModelError if tensor shapes differ.
    """
    for name in ("analysis", "hyper_analysis", "feedback"):
        tensors = getattr(trained, name).state_dict()
        load_into(getattr(sender, name), tensors, Path(f"the trained sender's {name}"))
