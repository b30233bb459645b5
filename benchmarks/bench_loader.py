"""Measure how fast training samples are drawn from chunks of realistic size, per worker process.

python benchmarks/bench_loader.py [--scenes 24] [--frames 180] [--samples 40]

Chunks of made JPEG frames of 640x360 pixels, as RealEstate10K has them, are written to a temporary folder. The rate is
that of CPU time, so other work on the machine changes it little. Each of the four GPUs of the paper takes one sample a
step.
"""

import argparse
import json
import tempfile
from io import BytesIO
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import torch
from PIL import Image

from fecocodec.training.chunk_scenes import REALESTATE10K, ChunkScenes

HEIGHT, WIDTH = 360, 640
SCENES_OF_A_CHUNK = 12


def write_scene(key: str, num_frames: int, rng: np.random.Generator) -> dict[str, object]:
    """Return one record of a chunk: noise upsampled to photograph-like detail, cameras that move sideways."""
    images = []
    for _ in range(num_frames):
        coarse = Image.fromarray(rng.integers(0, 256, (45, 80, 3), dtype=np.uint8)).resize((WIDTH, HEIGHT))
        stream = BytesIO()
        coarse.save(stream, "JPEG", quality=90)
        images.append(torch.frombuffer(bytearray(stream.getvalue()), dtype=torch.uint8))
    cameras = torch.zeros(num_frames, 18)
    cameras[:, :4] = torch.tensor([0.5, 0.9, 0.5, 0.5])
    cameras[:, 6:] = torch.eye(4)[:3].flatten()
    cameras[:, 9] = 0.01 * torch.arange(num_frames)
    return {"key": key, "url": "https://video.example/", "timestamps": torch.arange(num_frames), "cameras": cameras,
            "images": images}  # fmt: skip


def write_chunks(folder: Path, num_scenes: int, num_frames: int) -> int:
    """Write chunks and their index; returns the bytes of the largest chunk."""
    rng, index = np.random.default_rng(0), {}
    for first in range(0, num_scenes, SCENES_OF_A_CHUNK):
        name = f"{first // SCENES_OF_A_CHUNK:06}.torch"
        keys = [f"scene{number}" for number in range(first, min(first + SCENES_OF_A_CHUNK, num_scenes))]
        torch.save([write_scene(key, num_frames, rng) for key in keys], folder / name)
        index |= dict.fromkeys(keys, name)
    (folder / "index.json").write_text(json.dumps(index))
    return max(path.stat().st_size for path in folder.glob("*.torch"))


def main() -> None:
    """Print samples per second of CPU time and of wall time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=24, help="number of scenes  [default: 24]")
    parser.add_argument("--frames", type=int, default=180, help="frames of a scene  [default: 180]")
    parser.add_argument("--samples", type=int, default=40, help="samples to draw  [default: 40]")
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # as in a worker
    with tempfile.TemporaryDirectory() as folder:
        size = write_chunks(Path(folder), arguments.scenes, arguments.frames)
        scenes, generator = ChunkScenes(Path(folder), 0.0, REALESTATE10K), torch.Generator().manual_seed(0)
        wall, processor = perf_counter(), process_time()
        for step in range(arguments.samples):
            scenes.at_step(step, 0, 1).sample(generator, num_context=2, num_target=4, size=(256, 256))
        wall, processor = perf_counter() - wall, process_time() - processor
    print(
        f"chunks of {size / 2**20:.0f} MiB, 6 views of 256x256 a sample: {arguments.samples / processor:.1f} samples "
        f"per second of CPU time, {arguments.samples / wall:.1f} per second"
    )


if __name__ == "__main__":
    main()
