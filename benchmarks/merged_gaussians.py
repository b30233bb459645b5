"""Measure what merging at the receiver saves and costs, on an evaluation index and on synthetic rooms.

python benchmarks/merged_gaussians.py MODEL_FOLDER ROOT INDEX.json [--views 2 4 8] [--lmbda 1e-3]

Each entry is encoded once and decoded with and without merging. Rooms have no pattern, and the most patterns.
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from time import process_time

import torch

from fecocodec.captures.evaluation_index import read_index
from fecocodec.container import quantise_lambda
from fecocodec.decoding import decode
from fecocodec.evaluation.novel_views import open_scenes, render_views, without_guides
from fecocodec.evaluation.stress.box_room import Room, blank, painted, photograph, sideways
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with

REPEATS = 5  # of decoding; the fastest counts


def main() -> None:
    """Print one line per scene: Gaussians, PSNR of target and context views, and processor time, without and with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("root", type=Path, help="folder with one folder per scene")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--views", type=int, nargs="+", default=[2, 4, 8], help="numbers of context views")
    parser.add_argument("--lmbda", type=float, default=1e-3, help="lambda  [default: 1e-3]")
    arguments = parser.parse_args()
    codec, lambda_q = load_codec(arguments.model, "cpu"), quantise_lambda(arguments.lmbda)
    print("scene\tGaussians\tmerged\ttarget, dB\tmerged\tcontext, dB\tmerged\tdecode, CPU ms\tmerged")
    for name, views, num_context in scenes(arguments.root, arguments.index, arguments.views):
        data = encode_with(codec, views.select(list(range(num_context))), lambda_q)
        pairs = zip(*(measured(data, arguments.model, views, num_context, on) for on in (False, True)), strict=True)
        print("\t".join((name, *(f"{value:.6g}" for pair in pairs for value in pair))), flush=True)


def scenes(root: Path, index: Path, counts: list[int]) -> Iterator[tuple[str, Views, int]]:
    """Yield name, views and number of context views of rooms and entries."""
    for name, paint in (("blank room", blank), ("painted room", painted)):
        yield name, photograph(Room(paint), sideways(), (256, 256)), 2
    read = open_scenes(root, (256, 256))
    for entry in read_index(index):
        if len(entry.context) in counts:
            yield entry.name, without_guides(read(entry), entry)[0], len(entry.context)


@torch.no_grad()
def measured(data: bytes, model: Path, views: Views, num_context: int, is_merged: bool) -> tuple[float, ...]:
    """Return number of Gaussians, mean PSNR of target and context views, and milliseconds of decoding on one thread."""
    times = [process_time()]
    for _ in range(REPEATS):
        gaussians = decode(data, model=model, num_threads=1, is_merged=is_merged).gaussians
        times.append(process_time())
    elapsed = 1e3 * min(end - begin for begin, end in pairwise(times))
    images = views.outside_masks(render_views(Gaussians.of(gaussians), views))
    quality = psnr(images, views.images, views.ignored)
    return gaussians.count, float(quality[num_context:].mean()), float(quality[:num_context].mean()), elapsed


if __name__ == "__main__":
    main()
