"""The networks of a model folder: the sender, also with a third-party extractor, and both ends as one codec."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch

from fecocodec.checkpoint import (
    RECEIVER_FILE,
    SENDER_FILE,
    Weights,
    config_of,
    load_into,
    read_weights,
    serialise_weights,
)
from fecocodec.config import PAPER, AdaptedSenderConfig, LargeSenderConfig, ReceiverConfig, stored_fields
from fecocodec.errors import ModelError
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.receiver.model import Receiver, load_receiver
from fecocodec.sender.extractors.adapter import AdaptedExtractor, ConditionedAdapter, LargeExtractor
from fecocodec.sender.extractors.depthsplat_small.checkpoint import LoadReport, load_public_weights
from fecocodec.sender.model import EXTRACTORS, Sender

RECEIVER_ID = "receiver_model_id"
EXTRACTOR = "extractor"


def load_sender(path: Path, receiver: ReceiverConfig, model_id: bytes) -> Sender:
    """Load a sender for encoding: evaluation mode, no gradients.

    receiver, model_id: configuration and id of the receiver that decodes its streams. Raises ModelError for a missing,
    damaged or unknown file, for a sender that was trained with another receiver, and for a frozen extractor whose
    checkpoint is missing or another one.
    """
    weights = read_weights(path)
    if EXTRACTOR not in weights.config:
        raise ModelError(f"{path}: holds no sender; name a sender's weights file.")
    name = weights.config[EXTRACTOR]
    like = next((kind() for kind in EXTRACTORS if kind.extractor == name), None)
    if like is None:
        raise ModelError(f"{path}: its extractor {name!r} is not known to this version; install the one that made it.")
    config = config_of(weights, "sender", like, path)
    require_receiver(weights, model_id, path)
    sender = Sender(config, receiver)
    load_into(sender, weights.tensors, path)
    if isinstance(config, LargeSenderConfig):
        _load_recorded_extractor(sender, config, path)
    return sender.eval().requires_grad_(False)


def load_frozen_extractor(sender: Sender, source: Path) -> LoadReport:
    """Load the checkpoint of a frozen extractor, see `load_public_weights`, and record its path and fingerprint."""
    report = load_public_weights(sender.extractor.frozen, source)
    recorded = {"fingerprint": sender.extractor.frozen.fingerprint(), "weights": str(source.resolve())}
    sender.config = replace(sender.config, **recorded)
    return report


def _load_recorded_extractor(sender: Sender, config: LargeSenderConfig, path: Path) -> None:
    """Load the checkpoint that a sender was trained with: from the folder of its file, or from where it was then."""
    recorded = Path(config.weights)
    places = [place for place in (path.parent / recorded.name, recorded) if place.is_file()]
    if not places:
        raise ModelError(
            f"{path}: needs the weights of its extractor, {recorded.name} ({config.fingerprint}), which are not at "
            f"{recorded}; put that file into the model's folder."
        )
    load_frozen_extractor(sender, places[0])
    if (found := sender.extractor.frozen.fingerprint()) != config.fingerprint:
        raise ModelError(
            f"{places[0]}: its tensors are {found}, but {path} was trained with {config.fingerprint}; put those there."
        )


def require_receiver(weights: Weights, model_id: bytes, path: Path) -> None:
    """Raise ModelError if the weights of a sender were trained for another receiver."""
    if weights.config.get(RECEIVER_ID) != model_id.hex():
        raise ModelError(
            f"{path}: this sender was made for the receiver {weights.config.get(RECEIVER_ID)}, the one beside it is "
            f"{model_id.hex()}; put the two files of one model together."
        )


def serialise_sender(sender: Sender, model_id: bytes) -> bytes:
    """Return the bytes of the sender's weights file, in fp16. model_id: id of the receiver it was trained with."""
    config = sender.config
    described = {"sender": stored_fields(config), EXTRACTOR: config.extractor, RECEIVER_ID: model_id.hex()}
    return serialise_weights(dict(sender.state_dict()), described)


@dataclass(frozen=True)
class Codec:
    """Networks of sender and receiver on one device. model_id: id of the receiver, as stored in streams."""

    sender: Sender
    receiver: Receiver
    model_id: bytes

    @property
    def device(self) -> torch.device:
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


def adapted_sender(extractor: LargeExtractor, receiver: ReceiverConfig) -> Sender:
    """Return an untrained sender with this extractor, for a receiver with this configuration.

    Call `adopt_codec` before training to start from a trained codec. With the method "paper", the blocks of the adapter
    are conditioned on lambda, and g_a has the paper's width.
    """
    like = LargeSenderConfig if receiver.method == PAPER else AdaptedSenderConfig
    return _built(AdaptedSenderConfig(like.analysis_channels), extractor, receiver)


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
