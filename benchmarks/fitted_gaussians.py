"""What fitting Gaussians to the same photographs gives: the ceiling of a file, and what one would store instead.

python benchmarks/fitted_gaussians.py ROOT INDEX.json [--entry fox/guided4_1] [--lmbda 1e-4] [--steps 300 3000]

Each entry is encoded with its guides and decoded. Then all numbers of its Gaussians are fitted to the context views and
guides by Adam on the rasteriser, with the step sizes of 3D Gaussian Splatting, and stored as SPZ and SOG.
"""

import argparse
import tempfile
from pathlib import Path
from time import perf_counter

import torch
from torch import Tensor

from fecocodec.captures.evaluation_index import read_index
from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.novel_views import open_scenes, without_guides
from fecocodec.evaluation.systems.gaussian_compression import decode_spz, encode_spz
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views, joined
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.splat_files.gaussian_arrays import gaussian_arrays
from fecocodec.splat_files.gaussian_files import write_gaussians

# Step sizes of Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023; that of the means is
# in units of the extent of the cameras.
STEP_OF_MEANS, STEP_OF_SCALES, STEP_OF_ROTATIONS, STEP_OF_OPACITIES, STEP_OF_COLOURS = 1.6e-4, 5e-3, 1e-3, 0.05, 2.5e-3
VIEWS_OF_STEP = 4
LEAST, MOST = 1e-4, 1.0 - 1e-4  # opacities that can still change


def fit(gaussians: Gaussians, views: Views, num_steps: int) -> Gaussians:
    """Return Gaussians fitted to the views, four of which are compared in each step, by mean squared error."""
    centres = views.cameras.extrinsics[:, :3, 3]
    extent = 1.1 * float((centres - centres.mean(dim=0)).norm(dim=1).max())
    start = (
        gaussians.means,
        gaussians.scales.clamp_min(1e-9).log(),
        gaussians.rotations,
        gaussians.opacities.clamp(LEAST, MOST).logit(),
        gaussians.harmonics,
    )
    means, scales, rotations, opacities, harmonics = (part.detach().clone().requires_grad_() for part in start)

    def current() -> Gaussians:
        turned = torch.nn.functional.normalize(rotations, dim=-1)
        return Gaussians(means, scales.exp(), turned, opacities.sigmoid(), harmonics)

    rates = {
        STEP_OF_MEANS * extent: means,
        STEP_OF_SCALES: scales,
        STEP_OF_ROTATIONS: rotations,
        STEP_OF_OPACITIES: opacities,
        STEP_OF_COLOURS: harmonics,
    }
    adam = torch.optim.Adam([{"params": [part], "lr": rate} for rate, part in rates.items()], eps=1e-15)
    generator = torch.Generator().manual_seed(0)
    for _ in range(num_steps):
        seen = torch.randperm(len(views.images), generator=generator)[:VIEWS_OF_STEP].tolist()
        color = render(current(), views.cameras.select(seen), views.image_size).color
        adam.zero_grad()
        (color - views.images[seen]).square().mean().backward()
        adam.step()
    return Gaussians(*(part.detach() for part in current().fields()))


@torch.no_grad()
def quality(gaussians: Gaussians, views: Views) -> Tensor:
    """Return the PSNR of each view in dB."""
    return psnr(render(gaussians, views.cameras, views.image_size).color.clamp(0, 1), views.images)


def main() -> None:
    """Print one line for the decoded file, and one for each number of steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder with one folder per scene")
    parser.add_argument("index", type=Path, help="evaluation index (JSON) with guides")
    parser.add_argument("--entry", action="append", help="name of an entry; can be repeated  [default: all]")
    parser.add_argument("--lmbda", type=float, default=1e-4)
    parser.add_argument("--steps", type=int, nargs="+", default=[300])
    parser.add_argument("--size", type=int, default=256, help="image side in pixels  [default: 256]")
    arguments = parser.parse_args()
    codec, read = load_codec(model_folder(None), "cpu"), open_scenes(arguments.root, (arguments.size, arguments.size))
    print("entry\tsteps\tseconds\tfile KiB\tSPZ KiB\tSOG KiB\tfitted views, dB\ttargets, dB\ttargets of the SPZ, dB")
    for entry in read_index(arguments.index):
        if arguments.entry and entry.name not in arguments.entry:
            continue
        views, guides = without_guides(read(entry), entry)
        count = len(entry.context)
        context, targets = views.select(list(range(count))), views.select(list(range(count, len(views.images))))
        begin = perf_counter()
        data = encode_with(codec, context, quantise_lambda(arguments.lmbda), guides=guides)
        encoded = perf_counter() - begin
        decoded = decode_with(codec.receiver, data, merging=None).gaussians
        seen = context if guides is None else joined([context, guides])
        for steps in (0, *arguments.steps):
            begin = perf_counter()
            fitted = fit(decoded, seen, steps)
            seconds = encoded + perf_counter() - begin
            spz = encode_spz(fitted)
            with tempfile.TemporaryDirectory() as folder:
                write_gaussians(Path(folder, "scene.sog"), gaussian_arrays(fitted, "scene.sog"))
                sog = Path(folder, "scene.sog").stat().st_size
            stored = quality(decode_spz(spz), targets).mean()
            found = quality(fitted, seen).mean(), quality(fitted, targets).mean(), stored
            sizes = "\t".join(f"{size / 1024:.1f}" for size in (len(data), len(spz), sog))
            row = "\t".join(f"{float(one):.2f}" for one in found)
            print(f"{entry.name}\t{steps}\t{seconds:.0f}\t{sizes}\t{row}", flush=True)


if __name__ == "__main__":
    main()
