"""Load and serialise the receiver's weights."""

from pathlib import Path

from torch import Tensor

from fecocodec.checkpoint import config_of, load_into, read_weights, serialise_weights
from fecocodec.coding.fixed_point import export_integers, load_integers
from fecocodec.config import ReceiverConfig, stored_fields
from fecocodec.receiver.model import Receiver

PRIOR = "prior."


def load_receiver(path: Path) -> tuple[Receiver, bytes]:
    """Return the receiver in evaluation mode, without gradients, and its model id.

    Raises ModelError if the file is missing, damaged, or not a receiver of this version.
    """
    weights = read_weights(path)
    receiver = Receiver(config_of(weights, "receiver", ReceiverConfig(), path))
    integers = {name.removeprefix(PRIOR): value for name, value in weights.tensors.items() if name.startswith(PRIOR)}
    load_integers(receiver.prior, integers)
    floats = {name: value for name, value in weights.tensors.items() if not name.startswith(PRIOR)}
    load_into(receiver, floats | _prior_floats(receiver), path)
    return receiver.eval().requires_grad_(False), weights.model_id


def serialise_receiver(receiver: Receiver) -> bytes:
    """Return the bytes of the receiver's weights file: integers for the entropy model, fp16 for all else."""
    integers = {PRIOR + name: value for name, value in export_integers(receiver.prior).items()}
    floats = {name: value for name, value in receiver.state_dict().items() if not name.startswith(PRIOR)}
    return serialise_weights(floats | integers, {"receiver": stored_fields(receiver.config)})


def _prior_floats(receiver: Receiver) -> dict[str, Tensor]:
    return {name: value for name, value in receiver.state_dict().items() if name.startswith(PRIOR)}
