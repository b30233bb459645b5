"""Benchmark the paper's sender (profile `paper`, depthsplat-small) against required bounds: `make bench-paper`.

Each case runs in its own process. The weights of the extractor are random, because time and memory do not depend on
them; the other networks are the shipped ones. Run it on an idle machine. If other processes share the cores, CPU time
divided by the number of threads is more reliable than wall time.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

import torch
from bench_codec import EXAMPLE, LAMBDA, repeated

from fecocodec.captures.scene_folder import read_views
from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.config import PaperSenderConfig
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.machine import peak_mib
from fecocodec.receiver.model import load_receiver
from fecocodec.sender.codec import Codec, adopt_codec, load_sender
from fecocodec.sender.encode import encode_with
from fecocodec.sender.model import Sender
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder


@dataclass(frozen=True)
class Case:
    """One benchmark case and its bounds.

    size: (height, width) in pixels. matching_scale: 2 builds the cost volume at half resolution. seconds, gibibytes:
    required bounds.
    """

    num_views: int
    size: tuple[int, int]
    matching_scale: int
    seconds: float
    gibibytes: float

    def __str__(self) -> str:
        matched = "1/4" if self.matching_scale == 1 else "1/8"
        return f"{self.num_views} views {self.size[0]}x{self.size[1]}, cost volume at {matched}"


@dataclass(frozen=True)
class Taken:
    """Wall time and CPU time in seconds, and the peak resident memory of the process so far in GiB."""

    wall: float
    processor: float
    peak: float


CASES = (
    Case(2, (256, 256), 1, 8.0, 2.0),
    Case(8, (256, 448), 1, 60.0, 4.0),
    Case(8, (256, 448), 2, 60.0, 4.0),
)


def paper_profile(matching_scale: int) -> Codec:
    """Return the shipped codec with an untrained extractor of the paper's profile."""
    folder = SHIPPED / DEFAULT_MODEL
    receiver, model_id = load_receiver(folder / RECEIVER_FILE)
    sender = Sender(PaperSenderConfig(geometry="exact", matching_scale=matching_scale), receiver.config)
    adopt_codec(sender, load_sender(folder / SENDER_FILE, receiver.config, model_id))
    return Codec(sender.eval().requires_grad_(False), receiver, model_id)


def run_case(case: Case) -> Iterator[tuple[str, Taken]]:
    """Measure the extraction of features, then the whole encoding."""
    codec = paper_profile(case.matching_scale)
    views = repeated(read_views(EXAMPLE, size=case.size), case.num_views)
    lambda_q = quantise_lambda(LAMBDA)
    scene = prepare_scene(views, codec.device)
    calls = {
        "features": lambda: SceneEncoder.of(codec, scene)._features,
        "encode": lambda: encode_with(codec, views, lambda_q, 2),
    }
    for name, call in calls.items():
        wall, processor = perf_counter(), process_time()
        with torch.no_grad():
            call()
        peak = (peak_mib() or float("nan")) / 1024
        yield name, Taken(perf_counter() - wall, process_time() - processor, peak)


def main() -> None:
    """Print a Markdown table: task, time, memory, bounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", type=int, help=argparse.SUPPRESS)  # used for child processes
    arguments = parser.parse_args()
    if arguments.case is not None:
        case = CASES[arguments.case]
        for name, taken in run_case(case):
            times = f"{taken.wall:.2f} s | {taken.processor:.2f} s | {case.seconds:g} s"
            print(f"| {name}, {case} | {times} | {taken.peak:.2f} GiB | {case.gibibytes:g} GiB |", flush=True)
        return
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads, lambda {LAMBDA:g}\n")
    print("| what | wall | processor | bound | peak memory so far | bound |\n|---|---|---|---|---|---|", flush=True)
    for number in range(len(CASES)):
        subprocess.run([sys.executable, str(Path(__file__)), "--case", str(number)], check=True)


if __name__ == "__main__":
    main()
