"""Measure `fecosplat decode` on hand-made files that are valid, tiny and as expensive as the format allows.

    python benchmarks/worst_files.py
    python benchmarks/worst_files.py --only coincident --receiver torch

Every file has 2^22 pixels in all, the default limit of `decode`, and both stages; its cameras or symbols are chosen to
make a step of decoding slow. Each file is decoded by a process of its own: `fecosplat decode`, which uses onnxruntime,
or the receiver in torch with --receiver torch. Prints bytes, Gaussians, wall time, CPU time (user and system), peak
memory, and the speed of one core just before: Gflop per CPU second of a float32 matrix product. CPU time is comparable
only at equal speed, which varies on shared machines. The exit code is 1 if a file takes more CPU time than CORES idle
cores have in MOST_SECONDS, or more than MOST_GIB.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import torch  # noqa: E402

from fecocodec.checkpoint import RECEIVER_FILE, model_folder  # noqa: E402
from fecocodec.coding.payload import encode_latents  # noqa: E402
from fecocodec.container import Header, PackedCameras, Stream, write_stream  # noqa: E402
from fecocodec.container.camera_validation import MAX_FOCAL, MIN_DEPTH_RATIO, MIN_FOCAL  # noqa: E402
from fecocodec.receiver.model import Receiver, load_receiver  # noqa: E402

CORES, MOST_SECONDS, MOST_GIB = 2, 10.0, 1.5  # bounds for files of at most LARGEST_FILE bytes
LARGEST_FILE = 64 << 10
TORCH_PROGRAM = """
import json, sys, torch, fecocodec
from fecocodec.receiver.decode import decode
from pathlib import Path
torch.set_num_threads(int(sys.argv[3]))
decoded = decode(Path(sys.argv[1]).read_bytes())
fecocodec.write_ply(Path(sys.argv[2]), decoded.gaussians, overwrite=True)
print(json.dumps({"gaussians": decoded.gaussians.count}))
"""
LATENT, HYPER = 8, 32  # pixels per latent and per hyper-latent
VIEWS, SIDE = 16, 512


@dataclass(frozen=True)
class WorstFile:
    """Parameters of a file. noise: standard deviation of the latents before rounding; baseline: between cameras."""

    views: int = VIEWS
    height: int = SIDE
    width: int = SIDE
    focal: float = 1.0
    baseline: float = 0.125
    far: float = 8.0
    noise: float = 0.0
    lambda_q: int = 1179


FILES = {
    "ordinary": WorstFile(),
    "one position": WorstFile(baseline=0.0),
    "one depth": WorstFile(baseline=0.0, far=MIN_DEPTH_RATIO),
    "coincident": WorstFile(baseline=0.0, focal=MAX_FOCAL, far=MIN_DEPTH_RATIO),
    "widest": WorstFile(baseline=64.0, focal=MIN_FOCAL, far=2.0**14),
    "far apart": WorstFile(baseline=1024.0, far=2.0**14),
    "four largest views": WorstFile(views=4, height=1024, width=1024),
    "widest images": WorstFile(views=16, height=256, width=1024),
    "finest lambda": WorstFile(lambda_q=0),
    "noise": WorstFile(noise=0.02),
}


def make_file(receiver: Receiver, model_id: bytes, worst: WorstFile) -> bytes:
    """Return the bytes of the stream."""
    size = (worst.views, worst.height, worst.width)
    payloads, digests = code_stages(receiver, size, worst.noise, worst.lambda_q)
    header = Header(model_id, *size, worst.lambda_q, digests)
    poses = tuple(
        (1.0, 0.0, 0.0, worst.baseline * view, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0) for view in range(worst.views)
    )
    cameras = PackedCameras(poses, ((worst.focal, worst.focal, 0.5, 0.5),) * worst.views, near=1.0, far=worst.far)
    return write_stream(Stream(header, cameras, payloads))


@cache
@torch.no_grad()
def code_stages(
    receiver: Receiver, size: tuple[int, int, int], noise: float, lambda_q: int
) -> tuple[tuple[bytes, bytes], tuple[bytes, bytes]]:
    """Return payloads and digests of both stages of latents that are noise around 0. size: (views, height, width)."""
    generator = torch.Generator().manual_seed(0)
    y, z = (
        noise * torch.randn(size[0], channels, size[1] // step, size[2] // step, generator=generator)
        for channels, step in ((receiver.config.latent_channels, LATENT), (receiver.config.hyper_channels, HYPER))
    )
    first, coded = encode_latents(receiver.prior, y, z, lambda_q, 1, None)
    last, coded_last = encode_latents(receiver.prior, y, z, lambda_q, 2, coded.y_hat)
    return (first, last), (coded.digest(), coded_last.digest())


def decode_command(receiver: str, file: Path, output: Path, threads: int) -> list[str]:
    """Return the command line that decodes a file and prints JSON with the number of Gaussians."""
    if receiver == "torch":
        return [sys.executable, "-c", TORCH_PROGRAM, str(file), str(output), str(threads)]
    command = [sys.executable, "-m", "fecosplat_cli", "decode", str(file), "-o", str(output), "--overwrite", "--json"]
    return [*command, "--threads", str(threads)]


def measure(file: Path, receiver: str, threads: int) -> dict[str, float]:
    """Decode a file by a new process; return the number of Gaussians, wall and CPU seconds, and peak memory in GiB."""
    output = file.with_suffix(".ply")
    command = decode_command(receiver, file, output, threads)
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT)
    assert process.stdout is not None
    printed = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    output.unlink(missing_ok=True)
    return {
        "gaussians": json.loads(printed)["gaussians"] if process.returncode == 0 else -1,
        "wall": wall,
        "cpu": usage.ru_utime + usage.ru_stime,
        "gib": usage.ru_maxrss / 2**20,
    }


def gflop_per_second() -> float:
    """Return Gflop per CPU second of the product of two float32 matrices, by one thread."""
    side = 2048
    matrix = torch.rand(side, side)
    torch.set_num_threads(1)
    matrix @ matrix  # load the library
    start = time.process_time()
    matrix @ matrix
    return 2e-9 * side**3 / (time.process_time() - start)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=list(FILES), help="measure this file; repeat for several")
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "worst", help="keep the files here")
    parser.add_argument("--threads", type=int, default=CORES, help="threads of decode; waiting threads use CPU time")
    parser.add_argument(
        "--receiver", choices=("onnxruntime", "torch"), default="onnxruntime", help="decoder to measure"
    )
    parser.add_argument("--reuse", action="store_true", help="measure the files that an earlier run left in the folder")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    receiver, model_id = load_receiver(model_folder(None) / RECEIVER_FILE)
    failures = 0
    print(f"{'file':<20} {'bytes':>7} {'Gaussians':>9} {'wall s':>7} {'CPU s':>6} {'GiB':>5} {'Gflop/s':>7}")
    for name in options.only or FILES:
        file = options.folder / f"{name.replace(' ', '_')}.fcs"
        if not (options.reuse and file.exists()):
            file.write_bytes(make_file(receiver, model_id, FILES[name]))
        speed = gflop_per_second()
        size, found = file.stat().st_size, measure(file, options.receiver, options.threads)
        is_within = found["cpu"] <= CORES * MOST_SECONDS and found["gib"] <= MOST_GIB and found["gaussians"] >= 0
        failures += not is_within and size <= LARGEST_FILE
        numbers = f"{size:7} {found['gaussians']:9.0f} {found['wall']:7.1f} {found['cpu']:6.1f} {found['gib']:5.2f}"
        print(f"{name:<20} {numbers} {speed:7.0f}  {'' if is_within else 'exceeds the bound'}", flush=True)
    return failures > 0


if __name__ == "__main__":
    sys.exit(main())
