"""A training checkpoint -> the weights files that ship: averaged weights, fp16, integers for the prior."""

from pathlib import Path

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.load import serialise_receiver
from fecocodec.receiver.model import Receiver
from fecocodec.sender.load import serialise_sender
from fecocodec.sender.model import Sender
from fecocodec.training.checkpoint import load_checkpoint


def export_model(checkpoint: Path, folder: Path) -> None:
    """Write `receiver.safetensors` and `sender.safetensors` of a checkpoint's averaged weights into `folder`."""
    average = load_checkpoint(checkpoint)["average"]
    config = ReceiverConfig()
    receiver, sender = Receiver(config), Sender(SenderConfig(), config)
    for name, network in (("receiver.", receiver), ("sender.", sender)):
        network.load_state_dict({k.removeprefix(name): v for k, v in average.items() if k.startswith(name)})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / RECEIVER_FILE).write_bytes(serialise_receiver(receiver))
    (folder / SENDER_FILE).write_bytes(serialise_sender(sender))
