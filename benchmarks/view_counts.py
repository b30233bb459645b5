"""Compare coding of all context views of an entry with coding of two of them, at the same target views.

    python benchmarks/view_counts.py MODEL_FOLDER ROOT INDEX.json [--lambdas 1e-3 1e-4]

For every entry with more than two context views, the whole set and each pair are encoded to separate files. "best pair"
is the pair with the best mean PSNR at the targets, which a sender cannot know. "nearest pair" has the cameras nearest
to those of the targets, which a sender can know. "mean pair" is the mean over all pairs.
"""

import argparse
from itertools import combinations
from pathlib import Path
from statistics import mean

import torch

from fecocodec.evaluation.novel_views import Score, score
from fecocodec.evaluation.systems.codec import codec_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.formats.evaluation_index import IndexEntry, read_index
from fecocodec.formats.scene_folder import read_views
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import load_codec


def score_of(system: System, views: Views, chosen: tuple[int, ...], num_context: int) -> Score:
    """Encode the chosen context views, and measure quality at all target views."""
    targets = range(num_context, len(views.images))
    return score(system, "", views.select([*chosen, *targets]), len(chosen))


def nearest_pair(views: Views, num_context: int) -> tuple[int, ...]:
    """Return the two context views with the smallest mean distance of their cameras to those of the targets."""
    centres = views.cameras.extrinsics[:, :3, 3]
    distance = torch.cdist(centres[:num_context], centres[num_context:]).mean(dim=1)
    return tuple(sorted(distance.argsort()[:2].tolist()))


def compare(system: System, root: Path, entry: IndexEntry, size: tuple[int, int]) -> list[float]:
    """Return PSNR in dB of all views, nearest pair, best pair and mean pair, then KiB of all views and mean pair.

    size: (height, width) in pixels.
    """
    count = len(entry.context)
    views = read_views(root / entry.scene, views=(*entry.context, *entry.target), size=size)
    every = score_of(system, views, tuple(range(count)), count)
    pairs = {pair: score_of(system, views, pair, count) for pair in combinations(range(count), 2)}
    quality = {pair: found.target_psnr for pair, found in pairs.items()}
    kib = mean(found.num_bytes for found in pairs.values()) / 1024
    nearest = quality[nearest_pair(views, count)]
    best, average = max(quality.values()), mean(quality.values())
    return [every.target_psnr, nearest, best, average, every.num_bytes / 1024, kib]


def main() -> None:
    """Print one line per entry and lambda, then the means for each number of views."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("root", type=Path, help="folder with one folder per scene")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--lambdas", type=float, nargs="+", default=[1e-3])
    parser.add_argument(
        "--most-views", type=int, default=4, help="skip entries with more views (8 views have 28 pairs)"
    )
    parser.add_argument("--size", type=int, default=256, help="image side in pixels  [default: 256]")
    arguments = parser.parse_args()
    codec = load_codec(arguments.model, "cpu")
    entries = [entry for entry in read_index(arguments.index) if 2 < len(entry.context) <= arguments.most_views]
    size = (arguments.size, arguments.size)
    print("lambda\tentry\tviews\tall, dB\tnearest pair, dB\tbest pair, dB\tmean pair, dB\tall, KiB\tmean pair, KiB")
    for lmbda in arguments.lambdas:
        rows: dict[int, list[list[float]]] = {}
        for entry in entries:
            row = compare(codec_system(codec, lmbda), arguments.root, entry, size)
            rows.setdefault(len(entry.context), []).append(row)
            _print_row(lmbda, entry.name, len(entry.context), row)
        for count, found in rows.items():
            _print_row(lmbda, f"mean of {len(found)}", count, [mean(column) for column in zip(*found, strict=True)])


def _print_row(lmbda: float, name: str, count: int, row: list[float]) -> None:
    print(f"{lmbda:g}\t{name}\t{count}\t" + "\t".join(f"{value:.2f}" for value in row), flush=True)


if __name__ == "__main__":
    main()
