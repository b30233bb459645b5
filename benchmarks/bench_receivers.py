"""Time and memory of decoding with torch and with onnxruntime: `python benchmarks/bench_receivers.py [FILE.fcs]`.

Whole processes run `fecosplat decode`; warm times are those of the library in one process. All use one thread unless
OMP_NUM_THREADS says otherwise. The rate of convolutions is measured in the same run, because machines differ. Their
floating-point operations are counted in a decoding of the same stream with torch.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter
from unittest.mock import patch

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "bitstream_spec" / "vectors" / "valid" / "scene-compact-6.fcs"
REPEATS = 7
# Runs one command, then prints its own time and the peak memory of the process in KiB (Linux).
CHILD = """
import resource, sys, time
start = time.perf_counter()
if sys.argv[1] == "torch":
    from fecocodec import decoding
    decoding.has_graphs = lambda folder, model_id: False
from fecosplat_cli.main import run
from fecosplat_cli.process import prepare_process
prepare_process()
code = run(sys.argv[2:])
print("measured", time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
sys.exit(code)
"""


def main() -> None:
    stream = Path(sys.argv[1]) if len(sys.argv) > 1 else SCENE
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    print(f"{stream.name}, {stream.stat().st_size} bytes, {os.environ['OMP_NUM_THREADS']} thread(s)")
    with tempfile.TemporaryDirectory() as folder:
        whole: dict[str, list[tuple[float, float, float]]] = {kind: [] for kind in ("torch", "onnxruntime")}
        for _ in range(REPEATS):
            for kind, found in whole.items():
                found.append(whole_process(kind, stream, Path(folder)))
    for kind, found in whole.items():
        seconds, own, memory = (median(values) for values in zip(*found, strict=True))
        print(f"{kind}: whole process {seconds:.2f} s, {own:.2f} s without the interpreter; {memory / 2**20:.3f} GiB")
    measure_warm(stream.read_bytes())


def whole_process(kind: str, stream: Path, folder: Path) -> tuple[float, float, float]:
    """Return wall seconds, seconds measured inside, and peak memory in KiB of one `fecosplat decode`."""
    command = [sys.executable, "-c", CHILD, kind, "decode", str(stream), "-o", str(folder / "a.ply"), "--overwrite"]
    start = perf_counter()
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds = perf_counter() - start
    _, own, memory = result.stdout.split()
    return seconds, float(own), float(memory)


def measure_warm(data: bytes) -> None:
    """Print warm times of both receivers, in turn, beside the time of the convolutions alone at the machine's rate."""
    import torch

    from fecocodec.decoding import decode
    from fecocodec.receiver.decode import decode as decode_with_torch

    num_threads = int(os.environ["OMP_NUM_THREADS"])
    convolution = torch.nn.Conv2d(176, 176, 3, padding=1).requires_grad_(False)
    convolution.weight.data = convolution.weight.data.contiguous(memory_format=torch.channels_last)
    maps = torch.rand(2, 176, 64, 64).contiguous(memory_format=torch.channels_last)
    gflop = 2 * 9 * 176 * 176 * maps.shape[0] * maps.shape[2] * maps.shape[3] / 1e9
    tasks: dict[str, Callable[[], object]] = {
        "convolutions": lambda: convolution(maps),
        "torch": lambda: decode_with_torch(data),
        "onnxruntime": lambda: decode(data, num_threads=num_threads),
    }
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for repeat in range(REPEATS + 2):
        for name, task in tasks.items():
            start = perf_counter()
            task()
            if repeat >= 2:
                times[name].append(perf_counter() - start)
    rate, needed = gflop / median(times["convolutions"]), convolution_gflop(lambda: decode_with_torch(data))
    limit = needed / rate
    print(f"convolutions: {rate:.0f} Gflop/s, so {needed:.1f} Gflop take {limit:.3f} s")
    for name in ("torch", "onnxruntime"):
        seconds = median(times[name])
        ratio = seconds / limit
        print(f"{name}: warm {seconds:.3f} s, fastest {min(times[name]):.3f} s, {ratio:.2f} times the convolutions")


def convolution_gflop(decoding: Callable[[], object]) -> float:
    """Return the floating-point operations of all convolutions, in 10^9. A multiplication and an addition are two.

    Those of size 1x1 are matrix products in torch, so they are counted as they are exported.
    """
    import torch
    from torch.utils.flop_counter import FlopCounterMode

    with FlopCounterMode(display=False) as counter, patch.object(torch.compiler, "is_exporting", lambda: True):
        decoding()
    counts = counter.get_flop_counts()["Global"]
    return sum(count for operation, count in counts.items() if operation is torch.ops.aten.convolution) / 1e9


if __name__ == "__main__":
    main()
