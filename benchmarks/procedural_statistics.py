"""Print statistics of procedural training scenes: quantiles over samples, as a Markdown table.

    python benchmarks/procedural_statistics.py [NUM_SAMPLES]

A sample has two context and two target views of 128x128 pixels, with built-in textures. The seed is 0.
"""

import sys
import time

import numpy as np
import torch

from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures
from fecocodec.training.samples import Sample

SIZE = (128, 128)
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def shared(sample: Sample, first: int, second: int) -> float:
    """Return the fraction of pixels of view `first` that are visible in view `second` (depth agrees within 2%)."""
    assert sample.depth is not None
    cameras = sample.views.cameras
    points = pixel_rays(cameras, *SIZE)[first : first + 1] * sample.depth[first][None, ..., None]
    world = camera_to_world_points(cameras.select([first]), points)[0]
    seen = (world - cameras.extrinsics[second, :3, 3]) @ cameras.extrinsics[second, :3, :3]
    uv = (seen @ cameras.intrinsics[second].T)[..., :2] / seen[..., 2:].clamp_min(1e-6)
    is_inside = (seen[..., 2] > 0) & ((uv > 0) & (uv < 1)).all(-1)
    column, row = ((uv[..., axis] * SIZE[1 - axis]).long().clamp(0, SIZE[1 - axis] - 1) for axis in (0, 1))
    return float((is_inside & ((sample.depth[second][row, column] / seen[..., 2] - 1).abs() < 0.02)).float().mean())


def describe(sample: Sample) -> dict[str, float]:
    """Return the statistics of one sample by name."""
    assert sample.depth is not None
    cameras, images = sample.views.cameras, sample.views.images
    baseline = float((cameras.extrinsics[1, :3, 3] - cameras.extrinsics[0, :3, 3]).norm())
    forward = cameras.extrinsics[:2, :3, 2]
    steps = (images.diff(dim=-1).abs().mean() + images.diff(dim=-2).abs().mean()) / 2
    return {
        "field of view, degrees": 2 * np.degrees(np.arctan(0.5 / float(cameras.intrinsics[0, 0, 0]))),
        "baseline of the context views over median depth": baseline / float(sample.depth[:2].median()),
        "turn between the context views, degrees": np.degrees(float((forward[0] @ forward[1]).clamp(-1, 1).arccos())),
        "share of a context view that the other shows": min(shared(sample, 0, 1), shared(sample, 1, 0)),
        "share of a target view that a context view shows": max(shared(sample, 2, 0), shared(sample, 2, 1)),
        "far over near": float(cameras.far / cameras.near),
        "near, scene units": float(cameras.near),
        "mean of the images, sRGB": float(images.mean()),
        "contrast (standard deviation)": float(images.std()),
        "mean step between neighbouring pixels": float(steps),
    }


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    torch.set_num_threads(1)
    world, generator = ProceduralWorld(pattern_textures(100)), torch.Generator().manual_seed(0)
    rows, times = [], []
    for _ in range(count):
        start = time.thread_time()
        sample = world.sample(generator, num_context=2, num_target=2, size=SIZE)
        times.append(1000 * (time.thread_time() - start))
        rows.append(describe(sample) | {"processor time of the sample, ms": times[-1]})
    print("| of a sample | " + " | ".join(f"{100 * q:.0f}%" for q in QUANTILES) + " |")
    print("|---" * (1 + len(QUANTILES)) + "|")
    for name in rows[0]:
        values = np.quantile([row[name] for row in rows], QUANTILES)
        print(f"| {name} | " + " | ".join(f"{value:.3g}" for value in values) + " |")


if __name__ == "__main__":
    main()
