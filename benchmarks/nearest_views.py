"""Measure what further context views give: the same target from its nearest 2, 4, 8, ... views.

    python benchmarks/nearest_views.py MODEL_FOLDER ROOT [--counts 2 4 8] [--effort default] [--size 192]
        [--guides 24] [--device cuda]

ROOT: a folder of scene folders, each with a `transforms.json`. One photograph of each scene is the target: of all
photographs in the order of how much they share with the others, the one after a third of them. Its context views are
those that share most with it, and those that share most after these guide. A scene with too few photographs is left
out of the larger counts.
"""

import argparse
from pathlib import Path
from statistics import mean

import numpy as np

from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.evaluation.novel_views import Score, open_scenes, score, without_guides
from fecocodec.evaluation.systems.codec import guided_system
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.sender.codec import load_codec
from fecocodec.training.photographs import read_posed_scene


def target_and_neighbours(folder: Path) -> tuple[int, list[int]]:
    """Return the target's index, and those of all other photographs, the one that shares most with it first."""
    shared = read_posed_scene(folder).covisibility
    order = np.argsort(-shared.sum(axis=1))
    target = int(order[len(order) // 3])
    return target, [int(other) for other in np.argsort(-shared[target]) if other != target]


def scores(
    system: System, folder: Path, counts: list[int], most_guides: int, size: tuple[int, int]
) -> dict[int, Score]:
    """Return the score for each number of context views that the scene has. size: (height, width) in pixels."""
    read = open_scenes(folder.parent, size)
    target, neighbours = target_and_neighbours(folder)
    found = {}
    for count in counts:
        if count <= len(neighbours):
            others = neighbours[count : count + most_guides]
            entry = IndexEntry(folder.name, folder.name, tuple(neighbours[:count]), (target,), tuple(others))
            views, guides = without_guides(read(entry), entry)
            found[count] = score(system, folder.name, views, count, guides)
    return found


def main() -> None:
    """Print one line for each scene and number of views, then the means of each number."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("root", type=Path, help="folder with one folder per scene")
    parser.add_argument("--counts", type=int, nargs="+", default=[2, 4, 8], help="numbers of context views")
    parser.add_argument("--effort", choices=("fast", "default", "best"), default="default")
    parser.add_argument("--lmbda", type=float, default=1e-3)
    parser.add_argument("--size", type=int, default=192, help="image side in pixels  [default: 192]")
    parser.add_argument("--guides", type=int, default=0, help="most photographs that guide  [default: 0]")
    parser.add_argument("--device", default="cpu", help="as for `fecosplat encode`  [default: cpu]")
    arguments = parser.parse_args()
    codec = load_codec(arguments.model, arguments.device)
    system = guided_system(codec, arguments.lmbda, effort=arguments.effort)

    rows: dict[int, list[Score]] = {count: [] for count in arguments.counts}
    print("scene\tviews\tKiB\tcontext, dB\ttarget, dB")
    for folder in sorted(path.parent for path in arguments.root.glob("*/transforms.json")):
        for count, found in scores(
            system, folder, arguments.counts, arguments.guides, (arguments.size, arguments.size)
        ).items():
            rows[count].append(found)
            print(line(folder.name, count, [found]), flush=True)
    for count, found_all in rows.items():
        if found_all:
            print(line(f"mean of {len(found_all)}", count, found_all))


def line(name: str, count: int, found: list[Score]) -> str:
    """Return a row of the table: means over scores."""
    kib, context, target = (
        mean(getattr(one, field) for one in found) for field in ("num_bytes", "context_psnr", "target_psnr")
    )
    return f"{name}\t{count}\t{kib / 1024:.1f}\t{context:.2f}\t{target:.2f}"


if __name__ == "__main__":
    main()
