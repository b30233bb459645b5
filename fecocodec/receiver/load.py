"""The receiver from its weights file and back."""

from dataclasses import asdict
from pathlib import Path

from torch import Tensor

from fecocodec.checkpoint import config_of, load_into, read_weights, serialise_weights
from fecocodec.coding.fixed_point import export_integers, load_integers
from fecocodec.config import ReceiverConfig
from fecocodec.receiver.model import Receiver

PRIOR = "prior."


def load_receiver(path: Path) -> tuple[Receiver, bytes]:
    """Receiver ready to decode, and its model id; raises ModelError for a missing, damaged or foreign file."""
    weights = read_weights(path)
    receiver = Receiver(config_of(weights, "receiver", ReceiverConfig(), path))
    integers = {name.removeprefix(PRIOR): value for name, value in weights.tensors.items() if name.startswith(PRIOR)}
    load_integers(receiver.prior, integers)
    floats = {name: value for name, value in weights.tensors.items() if not name.startswith(PRIOR)}
    load_into(receiver, floats | _prior_floats(receiver), path)
    return receiver.eval().requires_grad_(False), weights.model_id


def serialise_receiver(receiver: Receiver) -> bytes:
    """Bytes of the receiver's weights file: integers for the prior, fp16 for the rest."""
    integers = {PRIOR + name: value for name, value in export_integers(receiver.prior).items()}
    floats = {name: value for name, value in receiver.state_dict().items() if not name.startswith(PRIOR)}
    return serialise_weights(floats | integers, {"receiver": asdict(receiver.config)})


def _prior_floats(receiver: Receiver) -> dict[str, Tensor]:
    return {name: value for name, value in receiver.state_dict().items() if name.startswith(PRIOR)}
