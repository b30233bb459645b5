"""Benchmark time and memory of encode, decode and info against their required bounds: `make bench`.

In-process times are medians after a warm-up. Whole processes are measured from a cold start, with their peak resident
memory. Run it on an idle machine, because other load changes all results.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import torch

from fecocodec.captures.scene_folder import read_views
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.machine import StepClock
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with

EXAMPLE = Path(__file__).parent.parent / "examples" / "motorcycle"
LAMBDA = 1e-3
Progress = Callable[[str, float], None]


def measure(call: Callable[[Progress], object], repeats: int) -> tuple[float, str]:
    """Return the median seconds of a call after warm-up, and the medians of its steps as text."""
    call(lambda _task, _fraction: None)
    runs = [_seconds_by_step(call) for _ in range(repeats)]
    steps = {task: statistics.median(run[task] for run in runs) for task in runs[0]}
    text = ", ".join(f"{task} {1e3 * seconds:.0f}" for task, seconds in steps.items())
    return statistics.median(sum(run.values()) for run in runs), f"{text} ms"


def _seconds_by_step(call: Callable[[Progress], object]) -> dict[str, float]:
    clock = StepClock()
    call(clock)
    clock.close()
    return clock.seconds


def convolution_speed(repeats: int = 50) -> float:
    """Return the median Gflop/s of this machine in the most frequent layer of the receiver, after warm-up."""
    layer, x = torch.nn.Conv2d(96, 96, 3, padding=1), torch.randn(2, 96, 64, 64).to(memory_format=torch.channels_last)
    seconds = []
    with torch.inference_mode():
        for _ in range(repeats):
            begin = perf_counter()
            layer(x)
            seconds.append(perf_counter() - begin)
    return 2 * layer.weight.numel() * x.numel() / 96 / statistics.median(seconds) / 1e9


def bench_scene(codec: Codec, views: Views, label: str, repeats: int, bounds: tuple[float, float]) -> bytes:
    """Measure decoding and encoding of one scene in this process, after warm-up. Returns the stream.

    bounds: required seconds of decoding and of encoding.
    """
    lambda_q = quantise_lambda(LAMBDA)
    data = encode_with(codec, views, lambda_q, 2)
    decoded, steps = measure(lambda progress: decode(data, on_progress=progress), repeats)
    print(f"| decode, {label}, warm | {decoded:.3f} s | {bounds[0]} s | {steps} |", flush=True)
    encoded, steps = measure(
        lambda progress: encode_with(codec, views, lambda_q, on_progress=progress), max(3, repeats // 3)
    )
    print(f"| encode, {label}, warm | {encoded:.3f} s | {bounds[1]} s | {steps} |", flush=True)
    return data


# The peak memory of a child includes that of the process that forks it, so a small process starts the command.
LAUNCHER = """
import json, resource, subprocess, sys, time
begin = time.perf_counter()
code = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL)
seconds = time.perf_counter() - begin
print(json.dumps([code, seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20]))
"""


def bench_process(label: str, arguments: list[str], bounds: tuple[float, float | None], repeats: int = 3) -> None:
    """Measure the median wall time and the peak resident memory of a whole `fecosplat` process.

    bounds: required seconds, and required GiB or None.
    """
    program = str(Path(sys.executable).with_name("fecosplat"))
    runs = []
    for _ in range(repeats):
        command = [sys.executable, "-S", "-c", LAUNCHER, program, *arguments]
        code, seconds, gibibytes = json.loads(
            subprocess.run(command, check=True, capture_output=True, text=True).stdout
        )
        if code != 0:
            raise SystemExit(f"fecosplat {' '.join(arguments)} failed; run it by hand to see why")
        runs.append((seconds, gibibytes))
    print(f"| {label}, whole process | {statistics.median(s for s, _ in runs):.2f} s | {bounds[0]} s | |")
    if bounds[1] is not None:
        print(f"| {label}, peak memory | {max(m for _, m in runs):.2f} GiB | {bounds[1]} GiB | |", flush=True)


def bench_rendering(codec: Codec, views: Views, data: bytes, repeats: int) -> None:
    """Measure rendering of one image of the decoded Gaussians, forward and backward, on one thread."""
    gaussians = decode(data).gaussians
    camera = views.cameras.select([0])
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    forward = statistics.median(_seconds(lambda: render(gaussians, camera, views.image_size)) for _ in range(repeats))
    leaves = [field.clone().requires_grad_() for field in gaussians.fields()]
    tracked = replace(gaussians, **dict(zip(gaussians.__dataclass_fields__, leaves, strict=True)))
    images = [render(tracked, camera, views.image_size).color.sum() for _ in range(repeats)]
    backward = statistics.median(_seconds(image.backward) for image in images)
    torch.set_num_threads(threads)
    print(f"| render {gaussians.count} Gaussians, one thread | {forward:.3f} s | 0.025 s | |")
    print(f"| its gradients, one thread | {backward:.3f} s | 0.05 s | |", flush=True)


def _seconds(call: Callable[[], object]) -> float:
    begin = perf_counter()
    call()
    return perf_counter() - begin


def repeated(views: Views, count: int) -> Views:
    """Return `count` views by repeating the given ones, each copy slightly moved. Timing does not depend on content."""
    chosen = views.select([view % len(views.images) for view in range(count)])
    extrinsics = chosen.cameras.extrinsics.clone()
    extrinsics[:, 0, 3] += 0.01 * chosen.cameras.near * torch.arange(count)
    return replace(chosen, cameras=replace(chosen.cameras, extrinsics=extrinsics))


def main() -> None:
    """Print a Markdown table: task, measured value, bound, time by step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15, help="number of measured calls  [default: 15]")
    arguments = parser.parse_args()
    codec = load_codec(SHIPPED / DEFAULT_MODEL, "cpu")
    square = read_views(EXAMPLE, size=(256, 256))
    print(
        f"torch {torch.__version__}, {torch.get_num_threads()} threads, {convolution_speed():.0f} Gflop/s in "
        f"convolutions, lambda {LAMBDA:g}, {EXAMPLE.name}\n"
    )
    print("| what | measured | bound | steps |\n|---|---|---|---|")
    data = bench_scene(codec, square, "2 views 256x256", arguments.repeats, (0.117, 1.5))
    bench_rendering(codec, square, data, arguments.repeats)
    with tempfile.TemporaryDirectory() as folder:
        stream, cloud = Path(folder, "bench.fcs"), Path(folder, "bench.ply")
        encode = [
            "encode",
            str(EXAMPLE),
            "-o",
            str(stream),
            "--size",
            "256x256",
            "--lambda",
            str(LAMBDA),
            "--overwrite",
        ]
        bench_process("encode, 2 views 256x256", encode, (6.0, 1.3))
        bench_process("decode, 2 views 256x256", ["decode", str(stream), "-o", str(cloud), "--overwrite"], (4.0, 1.0))
        bench_process("info", ["info", str(stream)], (0.3, None))
    wide = repeated(read_views(EXAMPLE, size=(256, 448)), 8)
    bench_scene(codec, wide, "8 views 256x448", max(3, arguments.repeats // 5), (1.0, 10.0))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"| encode and decode, 8 views 256x448, peak memory of this process | {peak:.2f} GiB | 3.0 GiB | |")


if __name__ == "__main__":
    main()
