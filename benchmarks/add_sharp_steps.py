"""Add a network that proposes steps towards sharper pictures to a model: the mean of the step networks of others.

python benchmarks/add_sharp_steps.py MODEL_FOLDER OUT_FOLDER SHARP_FOLDER... [--between]

Each SHARP is the model, of which the step network alone was trained on with ST-LPIPS in its loss (`fecosplat train
--step-updates N --perceptual-weight W`, docs/training.md). With --between, the model's own step network becomes the
mean of itself and the new one: `encode --sharpness -1` then gives what 0 gave, and 0 what 0.5 gave.
"""

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

import torch

from fecocodec.atomic import make_folder, write_atomically
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.sender.codec import load_codec
from fecocodec.sender.load import serialise_sender
from fecocodec.sender.model import Sender


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("out", type=Path, help="folder for the weights with the new network")
    parser.add_argument("sharp", type=Path, nargs="+", help="folders of models whose step networks are averaged")
    parser.add_argument("--between", action="store_true", help="put the model's own network half-way to the new one")
    arguments = parser.parse_args()
    codec = load_codec(arguments.model, "cpu")
    tensors = [dict(load_codec(folder, "cpu").sender.state_dict()) for folder in arguments.sharp]
    names = [name for name in tensors[0] if name.startswith("steps.")]
    sharp = {f"sharp_{name}": torch.stack([found[name] for found in tensors]).mean(dim=0) for name in names}
    sender = Sender(replace(codec.sender.config, has_sharp_steps=True), codec.receiver.config)
    own = dict(codec.sender.state_dict())
    if arguments.between:
        own |= {name: (own[name] + sharp[f"sharp_{name}"]) / 2 for name in names}
    sender.load_state_dict(own | sharp)
    make_folder(arguments.out)
    receiver = arguments.model / RECEIVER_FILE
    if arguments.out.resolve() != arguments.model.resolve():
        shutil.copyfile(receiver, arguments.out / RECEIVER_FILE)
    with write_atomically(arguments.out / SENDER_FILE, overwrite=True) as temporary:
        temporary.write_bytes(serialise_sender(sender, model_id_of(receiver.read_bytes())))


if __name__ == "__main__":
    main()
