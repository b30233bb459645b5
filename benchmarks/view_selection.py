"""Measure the choice of views by `--views`: overlap of the chosen views, and quality at photographs between them.

    python benchmarks/view_selection.py FOLDER [FOLDER ...] --views auto spread:4 spread:8 even:8

Every third photograph of a capture is kept back. Views are chosen among the others and encoded with effort fast.
Targets are the photographs kept back whose camera lies between those of two chosen neighbours: nearer to each of the
two than they are to each other, and with a viewing direction within 30 degrees of theirs, or within the angle between
them. even:N, for comparison, takes photographs at equal steps of the capture. A row has:

confirmed     share of a view's pixels whose depth, colour and texture agree with another view: mean, and the smallest
context       PSNR of the chosen views as decoded: mean, and the smallest
target        PSNR of the targets: mean, and the smallest; "-" if there is none
warnings      number of sentences that `fecosplat encode` prints about the views
"""

import argparse
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from statistics import mean

import numpy as np
import torch

from fecocodec import DecodedQuality, check_input, quality_warnings
from fecocodec.camera_files.find import read_cameras
from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.scene_folder import read_views
from fecocodec.captures.view_spread import auto_views, spread_views
from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.optimisation_config import FAST
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.view_overlap import view_overlap

HEADER = "scene\tviews\tchosen\tKiB\tconfirmed\tcontext, dB\ttarget, dB\twarnings"


KEPT_BACK = 3  # every third photograph
LARGEST_ANGLE = 30.0  # degrees, between viewing directions; more if the two chosen views differ by more


def choose(folder: Path, selection: str) -> tuple[list[int], list[int]]:
    """Return the indices of the photographs that `--views` chooses, and of the targets."""
    scene = read_cameras(folder)
    kept = [index for index in range(len(scene.photographs)) if (index + 1) % KEPT_BACK]
    offered = replace(scene, photographs=[scene.photographs[index] for index in kept])
    kind, _, count = selection.partition(":")
    if kind == "auto":
        picked = auto_views(offered)
    elif kind == "spread":
        picked = spread_views(offered, int(count))
    else:
        picked = tuple(np.linspace(0, len(kept) - 1, int(count)).round().astype(int).tolist())
    chosen = [kept[index] for index in picked]
    poses = np.stack([photograph.camera_to_world for photograph in scene.photographs])
    return chosen, targets_between(poses, chosen, [index for index in range(len(poses)) if index not in kept])


def targets_between(poses: np.ndarray, chosen: list[int], candidates: list[int]) -> list[int]:
    """Return the candidates between neighbouring chosen cameras, at most one for each two of these.

    poses [frame 4 4]: camera-to-world. Two chosen cameras are neighbours if no third one is nearer to each of them than
    they are to each other (relative neighbourhood graph).
    """
    centres, directions = poses[:, :3, 3], poses[:, :3, 2]
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    cosine = directions @ directions.T
    targets = set()
    for first, second in combinations(chosen, 2):
        farther = np.maximum(distance[first], distance[second])
        if min((farther[index] for index in chosen if index not in (first, second)), default=np.inf) < farther[first]:
            continue
        least_cosine = min(np.cos(np.radians(LARGEST_ANGLE)), cosine[first, second])
        is_alike = np.minimum(cosine[first], cosine[second]) >= least_cosine
        between = [index for index in candidates if farther[index] < farther[first] and is_alike[index]]
        targets |= set(sorted(between, key=lambda index: farther[index])[:1])
    return sorted(targets)


def confirmed_shares(codec: Codec, views: Views) -> list[float]:
    """Return the share of each view's pixels that the best other view confirms, as `overlap_warnings` has it."""
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    overlap = view_overlap(scene.images[0], encoder.matching.depth.relative_disparity, scene.cameras.scene(0))
    shares: list[float] = torch.maximum(overlap.confirmed, overlap.confirmed.T).amax(dim=1).tolist()
    return shares


def measure(codec: Codec, folder: Path, selection: str, short_side: int, lmbda: float) -> str:
    """Return the row of one folder and one value of `--views`."""
    chosen, targets = choose(folder, selection)
    views = read_views(folder, views=(*chosen, *targets), size=size_of(folder, short_side))
    context = views.select(list(range(len(chosen))))
    warnings = [*context.notes, *check_input(context, "fast")]
    shares = confirmed_shares(codec, context)
    data = encode_with(codec, context, quantise_lambda(lmbda), config=FAST, on_warning=warnings.append)
    with torch.no_grad():
        rendered = render(decode_with(codec.receiver, data).gaussians, views.cameras, views.image_size).color
    quality = psnr(rendered.clamp(0, 1), views.images).tolist()
    of_context, of_target = quality[: len(chosen)], quality[len(chosen) :]
    warnings += quality_warnings(DecodedQuality(tuple(of_context)), context.names)
    of_each = ", ".join(f"{index}: {value:.1f}" for index, value in zip(targets, of_target, strict=True))
    for sentence in warnings:
        print(f"# {sentence}")
    print(f"# targets {of_each}")
    cells = [
        folder.name,
        selection,
        ",".join(map(str, chosen)),
        f"{len(data) / 1024:.1f}",
        f"{100 * mean(shares):.0f}%, {100 * min(shares):.0f}%",
        f"{mean(of_context):.2f}, {min(of_context):.2f}",
        f"{mean(of_target):.2f}, {min(of_target):.2f}" if of_target else "-",
        str(len(warnings)),
    ]
    return "\t".join(cells)


def size_of(folder: Path, short_side: int) -> tuple[int, int]:
    """Return (height, width) with this shorter side, and the longer one a multiple of 32 in about the same ratio."""
    height, width = choose_photographs(folder, views=(0,)).image_size
    ratio = short_side / min(height, width)
    return tuple(max(64, 32 * round(side * ratio / 32)) for side in (height, width))  # type: ignore[return-value]


def main() -> None:
    """Print one row per folder and selection."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="captures with cameras")
    parser.add_argument("--views", nargs="+", default=["auto", "spread:4", "spread:8"])
    parser.add_argument("--short-side", type=int, default=192, help="pixels, multiple of 32  [default: 192]")
    parser.add_argument("--lambda", dest="lmbda", type=float, default=1e-3)
    options = parser.parse_args()
    codec = load_codec(model_folder(None), "cpu")
    print(HEADER)
    for folder in options.folders:
        print(f"# {folder.name}: {len(read_cameras(folder).photographs)} photographs")
        for selection in options.views:
            print(measure(codec, folder, selection, options.short_side, options.lmbda), flush=True)


if __name__ == "__main__":
    main()
