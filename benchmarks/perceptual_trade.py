"""Show what sharpness, or perceptual training, changes, in metrics that it was trained on and in others.

    python benchmarks/perceptual_trade.py MODEL ROOT INDEX.json --dinov2 dinov2_vits14.safetensors [--trained OTHER]

By default, measures a model at several values of `encode --sharpness`. With OTHER, a model folder trained on from MODEL
with `fecosplat train --perceptual-weight`, measures weights between the two. Prints one line per share, and writes the
change of each error at target views, against the first share, to a chart. DINOv2's distance is 1 - cosine similarity of
patch features, at 196x196.
"""

import argparse
from pathlib import Path
from statistics import fmean

import torch
import torch.nn.functional as F
from torch import Tensor

from fecocodec.captures.evaluation_index import read_index
from fecocodec.captures.scene_folder import read_views
from fecocodec.config import COMPACT_SENDER, ReceiverConfig
from fecocodec.evaluation.quality import measure_quality
from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.png import write_png
from fecocodec.evaluation.systems.codec import codec_system
from fecocodec.receiver.model import Receiver
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender
from fecocodec.training.model_weights import load_model_weights

SHARES, SHARPNESS = (0.0, 0.25, 0.5, 0.75, 1.0), (-1.0, 0.0, 1.0)
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of DINOv2's input
DINO_SIDE = 196  # pixels
ERRORS = ("bytes", "ST-LPIPS (trained on)", "MSE", "1 - MS-SSIM", "FLIP", "DINOv2")


def networks_of(model: Path) -> torch.nn.ModuleDict:
    receiver = Receiver(ReceiverConfig())
    sender = Sender(COMPACT_SENDER, receiver.config)
    load_model_weights(sender, receiver, model)
    return torch.nn.ModuleDict({"receiver": receiver, "sender": sender}).eval().requires_grad_(False)


def mixed(plain: Path, trained: Path, share: float) -> Codec:
    """Return the codec whose weights are (1 - share) plain + share trained."""
    networks, others = networks_of(plain), networks_of(trained).state_dict()
    state = {
        k: torch.lerp(v, others[k], share) if v.is_floating_point() else v for k, v in networks.state_dict().items()
    }
    networks.load_state_dict(state)
    return Codec(networks["sender"], networks["receiver"], bytes(8))  # type: ignore[arg-type]


def dinov2_distance(extractor: DepthSplatSmall, images: Tensor, targets: Tensor) -> float:
    def features(x: Tensor) -> Tensor:
        x = F.interpolate(x, size=(DINO_SIDE, DINO_SIDE), mode="bicubic", antialias=True)
        normalised = (x - torch.tensor(MEAN)[:, None, None]) / torch.tensor(DEVIATION)[:, None, None]
        return F.normalize(extractor.pretrained(normalised), dim=1)

    return 1.0 - float((features(images) * features(targets)).sum(dim=1).mean())


@torch.no_grad()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("model", "root", "index"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--trained", type=Path, help="model folder trained on from MODEL")
    parser.add_argument("--dinov2", type=Path, required=True, help="weights of DINOv2 ViT-S/14")
    parser.add_argument("--lmbda", type=float, default=1e-3)
    parser.add_argument("--size", type=int, default=192, help="image side in pixels  [default: 192]")
    parser.add_argument("--every", type=int, default=1, help="measure every so many entries  [default: 1]")
    parser.add_argument("--output", type=Path, default=Path("docs/sharpness.png"))
    arguments = parser.parse_args()
    extractor = DepthSplatSmall().eval()
    load_public_weights(extractor, arguments.dinov2)
    entries = [e for e in read_index(arguments.index) if len(e.context) == 2][:: arguments.every]
    rows = []
    print("share\tKiB\tcontext PSNR\ttarget PSNR\t" + "\t".join(ERRORS[1:]))
    shares = SHARPNESS if arguments.trained is None else SHARES
    for share in shares:
        if arguments.trained is None:
            system = codec_system(load_codec(arguments.model, "cpu"), arguments.lmbda, sharpness=share)
        else:
            system = codec_system(mixed(arguments.model, arguments.trained, share), arguments.lmbda)
        measured = []
        for entry in entries:
            names, size = (*entry.context, *entry.target), (arguments.size, arguments.size)
            views = read_views(arguments.root / entry.scene, views=names, size=size, background="white")
            result = system.reconstruct(views, 2)
            target, context = (
                measure_quality(result.images[part], views.images[part]) for part in (slice(2, None), slice(2))
            )
            mse = float((result.images[2:] - views.images[2:]).square().mean())
            dino = dinov2_distance(extractor, result.images[2:], views.images[2:])
            errors = (result.num_bytes, target.st_lpips, mse, 1 - target.ms_ssim, target.flip, dino)
            measured.append((context.psnr, target.psnr, *errors))
        means = [fmean(column) for column in zip(*measured, strict=True)]
        rows.append(means[2:])
        print(
            f"{share:g}\t{means[2] / 1024:.2f}\t" + "\t".join(f"{value:.4f}" for value in (*means[:2], *means[3:])),
            flush=True,
        )
    series = tuple(
        Series(
            name,
            tuple(Mark(share, 100 * (row[k] / rows[0][k] - 1), name) for share, row in zip(shares, rows, strict=True)),
        )
        for k, name in enumerate(ERRORS)
    )
    what, axis = "Sharpness", "sharpness"
    if arguments.trained is not None:
        what, axis = "Perceptual training", "share of the trained weights"
    title = f"{what}, {len(entries)} pairs, lambda {arguments.lmbda:g}"
    write_png(Chart("perceptual_trade", title, axis, "change at target views, %", series), arguments.output)


if __name__ == "__main__":
    main()
