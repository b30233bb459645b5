"""Train a sender with a third-party extractor: the dense descriptors of DISK (Tyszkiewicz et al., 2020) from kornia.

Needs `pip install kornia`. The adapter and the other networks of the sender are trained; receiver and extractor are
frozen, so that the shipped receiver decodes the resulting files.

    python examples/larger_extractor.py SCENES OUT --minutes 30 [--disk depth]

SCENES: folders with transforms.json, or chunks of RealEstate10K. OUT: receives the model folder. `--disk depth`
downloads the published weights of DISK. Without it the weights are random, which is enough only to test the script.
"""

import argparse
import hashlib
from dataclasses import replace
from pathlib import Path

import torch
from einops import rearrange
from kornia.feature import DISK
from torch import Tensor

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SHIPPED
from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.codec import adapted_sender
from fecocodec.training.configurations import RunSettings, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.model_weights import export_networks
from fecocodec.training.sources import open_sources
from fecocodec.training.trainer import Trainer


class DiskExtractor:
    """DISK with the interface of `fecocodec.sender.extractors.adapter.LargeExtractor`."""

    def __init__(self, network: DISK) -> None:
        self.network = network.eval().requires_grad_(False)

    def num_channels(self) -> int:
        return self.network.desc_dim

    def features(self, images: Tensor, cameras: Cameras) -> Tensor:
        """Return the dense descriptors of every view. DISK processes each view independently, without cameras."""
        self.network.to(images.device)
        _, descriptors = self.network.heatmap_and_dense_descriptors(rearrange(images, "b v c h w -> (b v) c h w"))
        return rearrange(descriptors, "(b v) c h w -> b v c h w", b=len(images))

    def fingerprint(self) -> str:
        digest = hashlib.sha256()
        for name, value in sorted(self.network.state_dict().items()):
            digest.update(name.encode() + value.cpu().contiguous().numpy().tobytes())
        return f"disk-{digest.hexdigest()[:16]}"


def train_sender(extractor: DiskExtractor, scenes: Path, out: Path, minutes: float, model: Path) -> None:
    """Initialise the codec from a trained model, train the sender, and write the two weights files to `out`."""
    configuration = replace(configuration_named("compact"), frozen=("receiver",))
    sources = open_sources(scenes, None, configuration)
    sender = adapted_sender(extractor, configuration.receiver)
    trainer = Trainer(RunSettings(out / "run", configuration, minutes), sources, sender)
    trainer.start_from(model)
    for row in train(trainer):
        print(f"step {row['step']:.0f}  loss {row['loss']:.4g}")
    export_networks(trainer.checkpoint, out, trainer.receiver, trainer.sender, receiver_file=model / RECEIVER_FILE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--disk", help="name of DISK's published weights, such as depth")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    network = DISK.from_pretrained(arguments.disk) if arguments.disk else DISK()
    train_sender(DiskExtractor(network), arguments.scenes, arguments.out, arguments.minutes, SHIPPED / DEFAULT_MODEL)


if __name__ == "__main__":
    main()
