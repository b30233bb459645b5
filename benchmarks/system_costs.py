"""Parameters, seconds and peak memory of every system, as the paper's Table 1 has them: `make bench-systems`.

Each system runs in a process of its own, on the same pair of photographs: the codec at lambda 1e-3, the others at the
middle of their settings. Seconds are medians after a warm-up, without rendering. Peak memory is resident, of both ends
and rendering in one process. Who transmits photographs needs all our networks at the receiver and none at the sender;
who transmits Gaussians, the other way round. Run it on an idle machine.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from statistics import median

import torch
from bench_codec import EXAMPLE, LAMBDA

from fecocodec.captures.scene_folder import read_views
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED, model_id_of
from fecocodec.config import PAPER_RECEIVER, PAPER_SENDER
from fecocodec.evaluation.machine import describe_machine, peak_mib
from fecocodec.evaluation.paper_tables import cost_line, cost_table, costs_of, others, params_of_ends
from fecocodec.evaluation.summary import OURS, ExternalRow
from fecocodec.evaluation.systems.codec import FAST
from fecocodec.evaluation.systems.groups import systems_of
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.model import Sender

PAPERS = "the paper's profile, untrained"
GROUPS = {  # name of a system -> its group of `systems_of`
    OURS: "codec",
    FAST: "fast",
    "stage 1 alone": "stage-1",
    **dict.fromkeys(("JPEG XL", "AVIF", "JPEG", "AVIF, optimised at the receiver"), "images"),
    **dict.fromkeys(("Gaussians as HEVC", "SPZ"), "gaussians"),
    PAPERS: "codec",
}


def untrained() -> Codec:
    """Return the codec of the paper's profile with random weights. Its files are larger than those of a trained one."""
    torch.manual_seed(0)
    receiver, sender = Receiver(PAPER_RECEIVER), Sender(PAPER_SENDER, PAPER_RECEIVER)
    for network in (receiver, sender):
        to_channels_last(network.eval().requires_grad_(False), "cpu")
    return Codec(sender, receiver, model_id_of(serialise_receiver(receiver)))


def measure(name: str, side: int, repeats: int) -> ExternalRow:
    """Return the costs of a key of GROUPS in this process, for photographs of side x side pixels."""
    codec = untrained() if name == PAPERS else load_codec(SHIPPED / DEFAULT_MODEL, "cpu")
    own = OURS if name == PAPERS else name
    settings = [system for system in systems_of((GROUPS[name],), codec, (LAMBDA,)) if system.name == own]
    system, views = settings[len(settings) // 2], read_views(EXAMPLE, size=(side, side))
    seconds = []
    for _ in range(1 + repeats):
        found = system.reconstruct(views, len(views.images))
        seconds.append((found.encode_seconds, found.decode_seconds))
    peak = peak_mib()
    both, receiver = params_of_ends(codec)
    params = {"images": (0.0, both), "gaussians": (both, 0.0)}.get(GROUPS[name], (both, receiver))
    medians = map(median, zip(*seconds[1:], strict=True))
    label = f"{name}, {found.num_bytes / 1024:.1f} KiB"
    return costs_of(label, (*params, *medians, None if peak is None else peak / 1024))


def main() -> None:
    """Print a Markdown table: ours, measured; then those that the paper prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=256, help="side of the photographs in pixels  [default: 256]")
    parser.add_argument("--repeats", type=int, default=5, help="number of measured runs  [default: 5]")
    parser.add_argument("--system", choices=GROUPS, help=argparse.SUPPRESS)  # used for child processes
    arguments = parser.parse_args()
    if arguments.system is not None:
        print(json.dumps(asdict(measure(arguments.system, arguments.side, arguments.repeats))))
        return
    rows = []
    threads = {"NUMBA_NUM_THREADS": str(torch.get_num_threads())}  # gsply's would be more and get in the way of torch's
    for name in GROUPS:
        command = [sys.executable, str(Path(__file__)), *sys.argv[1:], "--system", name]
        result = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | threads)
        rows.append(ExternalRow(**json.loads(result.stdout)))
    print(", ".join(f"{key} {value}" for key, value in describe_machine().items()) + "\n")
    print(cost_table([*map(cost_line, rows), *others(())]), end="")


if __name__ == "__main__":
    main()
