"""Fit the detail layer of a trained model to training scenes, and write the weights with it.

python benchmarks/fit_detail.py MODEL_FOLDER SCENES INDEX.json OUT_FOLDER [--planes 64] [--entries 40]

Then make its graphs: `python -m fecocodec.training.graphs OUT_FOLDER`.
"""

import argparse
from pathlib import Path

from fecocodec.atomic import make_folder, write_atomically
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.receiver.load import serialise_receiver
from fecocodec.sender.codec import load_codec
from fecocodec.sender.load import serialise_sender
from fecocodec.training.detail_fit import coded_scenes, fit_detail


def main() -> None:
    """Print the new model id."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights, with or without a detail layer")
    parser.add_argument("root", type=Path, help="folder with one folder per training scene")
    parser.add_argument("index", type=Path, help="index (JSON) of pairs of training scenes")
    parser.add_argument("out", type=Path, help="folder for the weights with a new detail layer")
    parser.add_argument("--planes", type=int, default=64, help="[default: 64]")
    parser.add_argument("--entries", type=int, default=40, help="number of pairs, drawn from the index  [default: 40]")
    arguments = parser.parse_args()
    codec = load_codec(arguments.model, "cpu")
    coded = list(coded_scenes(codec, arguments.root, arguments.index, arguments.entries))
    data = serialise_receiver(fit_detail(codec, coded, arguments.planes))
    make_folder(arguments.out)
    for name, content in ((RECEIVER_FILE, data), (SENDER_FILE, serialise_sender(codec.sender, model_id_of(data)))):
        with write_atomically(arguments.out / name, overwrite=True) as temporary:
            temporary.write_bytes(content)
    print(f"{arguments.out}: model id {model_id_of(data).hex()}")


if __name__ == "__main__":
    main()
