"""Initial weights of a run and its frozen parts, for training several senders for one receiver.

The file of a frozen receiver stays equal to the byte, and with it the model id: streams of every sender that was
trained with it decode with the same receiver.
"""

from pathlib import Path

from torch import nn

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, load_into
from fecocodec.errors import InputError, ModelError
from fecocodec.receiver.load import load_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.sender.adapted import adopt_codec
from fecocodec.sender.extractors.depthsplat_small.checkpoint import LoadReport, load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.load import load_sender
from fecocodec.sender.model import Sender

TRAINED_ALONE = ("steps.", "sharp_steps.")  # parts that a model may lack
DETAIL = "detail."
FREEZABLE = ("receiver", "extractor", "matching")


def load_model_weights(sender: Sender, receiver: Receiver, model: Path) -> None:
    """Copy the weights of a model's folder, except those of an extractor of another kind.

    A sender keeps the initial weights of its step networks if the model has none, and does without them if it has none
    itself. The detail layer is left out: it is fitted to a trained receiver.
    Raises ModelError if the model is missing or has other sizes.
    """
    released, model_id = load_receiver(model / RECEIVER_FILE)
    trained = load_sender(model / SENDER_FILE, released.config, model_id)
    known = receiver.state_dict()
    load_into(
        receiver, {n: v for n, v in released.state_dict().items() if n in known or not n.startswith(DETAIL)}, model
    )
    if trained.config.extractor == sender.config.extractor:
        own = sender.state_dict()
        initial = {name: value for name, value in own.items() if name.startswith(TRAINED_ALONE)}
        found = trained.state_dict().items()
        load_into(
            sender, initial | {n: value for n, value in found if n in own or not n.startswith(TRAINED_ALONE)}, model
        )
    else:
        adopt_codec(sender, trained)


def load_fitting_weights(
    sender: Sender, receiver: Receiver, model: Path, anew: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Copy the weights of a model's folder that have the same name and shape, to start a variant of this model.

    anew: layers that are not copied, such as "receiver.predictor.head.2". Returns the names of the tensors that keep
    their initial values. Raises ModelError if the model is missing or damaged.
    """
    released, model_id = load_receiver(model / RECEIVER_FILE)
    trained = load_sender(model / SENDER_FILE, released.config, model_id)
    names: list[str] = []
    for part, network, source in (("receiver", receiver, released), ("sender", sender, trained)):
        known, tensors = source.state_dict(), network.state_dict()
        for name, tensor in tensors.items():
            is_anew = any(f"{part}.{name}".startswith(f"{layer}.") for layer in anew)
            if name in known and known[name].shape == tensor.shape and not is_anew:
                tensors[name] = known[name]
            else:
                names.append(f"{part}.{name}")
        network.load_state_dict(tensors)
    return tuple(names)


def load_extractor(sender: Sender, source: Path) -> LoadReport:
    """Load the extractor alone from a model's folder or, for depthsplat-small, from a public checkpoint.

    Raises ModelError if the source is missing, damaged, or has another kind of extractor.
    """
    if not source.is_dir():
        if not isinstance(sender.extractor, DepthSplatSmall):
            raise ModelError(f"{source}: public checkpoints are for depthsplat-small; name the folder of a model.")
        return load_public_weights(sender.extractor, source)
    released, model_id = load_receiver(source / RECEIVER_FILE)
    trained = load_sender(source / SENDER_FILE, released.config, model_id)
    if trained.config.extractor != sender.config.extractor:
        raise ModelError(
            f"{source}: its extractor is {trained.config.extractor}, this run's is {sender.config.extractor}; "
            "name another model."
        )
    tensors = trained.extractor.state_dict()
    load_into(sender.extractor, tensors, source)
    return LoadReport(tuple(tensors), (), ())


def freeze(sender: Sender, receiver: Receiver, names: tuple[str, ...]) -> None:
    """Exclude these parts from training: "receiver", "extractor", "matching" (all but fusion of the compact extractor).

    Raises InputError for any other name, and for "matching" with another extractor.
    """
    matching = sender.extractor.before_fusion
    parts: dict[str, tuple[nn.Module | nn.Parameter, ...]] = {
        "receiver": (receiver,),
        "extractor": (sender.extractor,),
        "matching": matching,
    }
    for name in names:
        if not parts.get(name):
            raise InputError(f"There is no part '{name}' to freeze; choose from {', '.join(FREEZABLE)}.")
        for part in parts[name]:
            part.requires_grad_(False)
