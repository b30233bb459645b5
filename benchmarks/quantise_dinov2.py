"""Make the file of DINOv2's 8-bit weights that the compact sender loads.

    python benchmarks/quantise_dinov2.py SOURCE.safetensors [OUTPUT]

SOURCE: the weights of DINOv2 ViT-S/14, with the names of Transformers or of DINOv2. Prints the relative error of the
features of the bundled photographs. `fecocodec/weights/dinov2_vits14/README.md` says where the shipped file comes from.
"""

import argparse
from pathlib import Path

import torch

from fecocodec.photographs.images import read_image
from fecocodec.sender.extractors import dinov2
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.extractors.vision_transformer import normalised

PHOTOGRAPHS = Path(__file__).parent.parent / "examples" / "motorcycle" / "images"


def main() -> None:
    """Write the file, and print its size and the error of its features."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="weights of DINOv2 ViT-S/14")
    parser.add_argument("output", type=Path, nargs="?", default=dinov2.FILE, help="file to write")
    arguments = parser.parse_args()
    extractor = DepthSplatSmall().eval()
    print(load_public_weights(extractor, arguments.source))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_bytes(dinov2.serialise_dinov2(extractor.pretrained))
    rounded = dinov2.load_dinov2(arguments.output)
    for path in sorted(PHOTOGRAPHS.glob("*.png")):
        image = normalised(read_image(path)[None, :, :252, :252])
        with torch.no_grad():
            exact, found = (network.after_blocks(image, dinov2.BLOCKS) for network in (extractor.pretrained, rounded))
        errors = [
            float((a - b).square().mean().sqrt() / a.square().mean().sqrt()) for a, b in zip(exact, found, strict=True)
        ]
        print(f"{path.name}: relative error of blocks {dinov2.BLOCKS}: {errors[0]:.4f}, {errors[1]:.4f}")
    print(f"{arguments.output}: {arguments.output.stat().st_size} bytes")


if __name__ == "__main__":
    main()
