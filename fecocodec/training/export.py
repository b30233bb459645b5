"""Export of a training checkpoint to weights files: averaged weights in fp16, the prior in integers."""

from pathlib import Path

from fecocodec.atomic import write_atomically
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.model_files import read_bytes
from fecocodec.receiver.load import serialise_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.sender.load import serialise_sender
from fecocodec.sender.model import Sender
from fecocodec.training.checkpoint import load_checkpoint
from fecocodec.training.configurations import Configuration


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
    """
    average = load_checkpoint(checkpoint)["average"]
    for name, network in (("receiver.", receiver), ("sender.", sender)):
        network.load_state_dict({k.removeprefix(name): v for k, v in average.items() if k.startswith(name)})
    folder.mkdir(parents=True, exist_ok=True)
    receiver_bytes = serialise_receiver(receiver) if receiver_file is None else read_bytes(receiver_file)
    for path, data in (
        (folder / RECEIVER_FILE, receiver_bytes),
        (folder / SENDER_FILE, serialise_sender(sender, model_id_of(receiver_bytes))),
    ):
        with write_atomically(path, overwrite=True) as temporary:
            temporary.write_bytes(data)
