"""Weights of a run: initial ones from model folders, frozen parts, and export to a model folder.

The file of a frozen receiver stays equal to the byte, and with it the model id: streams of every sender that was
trained with it decode with the same receiver. Exported are averaged weights in fp16, the prior in integers.
"""

from collections.abc import Mapping
from pathlib import Path

from torch import nn

from fecocodec.atomic import make_folder, write_atomically
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, load_into, model_id_of
from fecocodec.config import LargeSenderConfig
from fecocodec.errors import InputError, ModelError, some_of
from fecocodec.model_files import read_bytes
from fecocodec.receiver.model import Receiver, load_receiver, serialise_receiver
from fecocodec.sender.codec import adopt_codec, load_frozen_extractor, load_sender, serialise_sender
from fecocodec.sender.extractors.depthsplat_small.checkpoint import LoadReport, load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender
from fecocodec.training.configurations import Configuration
from fecocodec.training.run_files import load_checkpoint

TRAINED_ALONE = ("steps.", "sharp_steps.")  # parts that a model may lack
DETAIL = "detail."
FREEZABLE = ("receiver", "extractor", "matching")


def load_model_weights(sender: Sender, receiver: Receiver, model: Path) -> None:
    """Copy the weights of a model's folder, except those of an extractor of another kind.

    A sender keeps the initial weights of its step networks if the model has none, and does without them if it has none
    itself. The detail layer is left out: it is fitted to a trained receiver.
    Raises ModelError if the model is missing, or if the networks of its configuration are others.
    """
    released, model_id = load_receiver(model / RECEIVER_FILE)
    trained = load_sender(model / SENDER_FILE, released.config, model_id)
    try:
        _copy_weights(sender, receiver, trained, released, model)
    except ModelError as error:
        pairs = ((released.config, receiver.config), (trained.config, sender.config))
        changes = [change for configs in pairs for change in _changes(*map(vars, configs))]
        if not changes:
            raise
        reason = next((change for change in changes if change.startswith("method ")), some_of(changes))
        raise ModelError(
            f"{model}: the model was made with {reason}; name another model, or choose its `configuration`."
        ) from error


def _changes(theirs: Mapping[str, object], ours: Mapping[str, object]) -> list[str]:
    """Return in words the values that differ of the names in both."""
    return [f"{name} {theirs[name]}, not {value}" for name, value in ours.items() if theirs.get(name, value) != value]


def _copy_weights(sender: Sender, receiver: Receiver, trained: Sender, released: Receiver, model: Path) -> None:
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


def load_extractor(sender: Sender, source: Path) -> LoadReport:
    """Load the extractor alone from a model's folder or from a public checkpoint, frozen ones from the latter only.

    Raises ModelError if the source is missing, damaged, or has another kind of extractor.
    """
    if isinstance(sender.config, LargeSenderConfig):
        return load_frozen_extractor(sender, source)
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


def export_model(checkpoint: Path, folder: Path, configuration: Configuration, start: Path | None = None) -> None:
    """Write `receiver.safetensors` and `sender.safetensors` with a checkpoint's averaged weights to `folder`.

    configuration: that of the run. start: folder of the model with whose weights the run began; a frozen receiver is
    copied from there.
    Raises ModelError if the checkpoint cannot be read, OutputError if the folder cannot be written.
    """
    receiver, sender = Receiver(configuration.receiver), Sender(configuration.sender, configuration.receiver)
    is_frozen = start is not None and "receiver" in configuration.frozen
    export_networks(checkpoint, folder, receiver, sender, start / RECEIVER_FILE if start and is_frozen else None)


def export_networks(
    checkpoint: Path, folder: Path, receiver: Receiver, sender: Sender, receiver_file: Path | None = None
) -> None:
    """Export as `export_model` does, through these networks, which receive the averaged weights.

    receiver_file: weights file that is copied in place of the receiver.
    Raises ModelError for weights that are not finite.
    """
    average = load_checkpoint(checkpoint)["average"]
    if not all(bool(value.isfinite().all()) for value in average.values()):
        raise ModelError(
            f"{checkpoint}: its weights are not finite; train in another folder with a smaller `learning_rate`."
        )
    for name, network in (("receiver.", receiver), ("sender.", sender)):
        network.load_state_dict({k.removeprefix(name): v for k, v in average.items() if k.startswith(name)})
    receiver_bytes = serialise_receiver(receiver) if receiver_file is None else read_bytes(receiver_file)
    write_model(folder, receiver_bytes, sender)


def write_model(folder: Path, receiver: bytes, sender: Sender) -> None:
    """Write the weights files of a model. receiver: bytes of the receiver's file.

    Raises OutputError if the folder cannot be written.
    """
    make_folder(folder)
    for name, data in ((RECEIVER_FILE, receiver), (SENDER_FILE, serialise_sender(sender, model_id_of(receiver)))):
        with write_atomically(folder / name, overwrite=True) as temporary:
            temporary.write_bytes(data)
