"""Check that all configurations decode the same symbols, and Gaussians within tolerance.

    python benchmarks/conformance.py [--cuda] [--python PATH]

Each configuration below ("machine") runs in its own process, with its own number of threads, vector instructions,
number type, torch version or device. It checks the golden vectors, encodes the bundled scene at three lambdas, and
decodes the streams of all configurations. A different symbol, or a Gaussian beyond the tolerance, is an error.
`--python PATH` adds the interpreter of another environment, such as one with another version of torch.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
import torch  # noqa: E402

from tests.vectors.gaussian_difference import Difference, beyond, difference  # noqa: E402

AVX2 = {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2", "MKL_ENABLE_INSTRUCTIONS": "AVX2"}
SSE41 = {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41", "MKL_ENABLE_INSTRUCTIONS": "SSE4_2"}
SCALAR = {**SSE41, "MKL_CBWR": "COMPATIBLE", "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512_SKX"}


@dataclass(frozen=True)
class Machine:
    """One configuration. environment: additional environment variables. number_type: "fp32" or "bf16"."""

    name: str
    environment: dict[str, str] = field(default_factory=dict)
    number_type: str = "fp32"
    device: str = "cpu"
    python: str = sys.executable


MACHINES = (
    Machine("one thread", {"OMP_NUM_THREADS": "1"}),
    Machine("two threads", {"OMP_NUM_THREADS": "2"}),
    # MKL would take no more threads than there are cores.
    Machine("four threads", {"OMP_NUM_THREADS": "4", "MKL_DYNAMIC": "FALSE"}),
    Machine("AVX2", {"OMP_NUM_THREADS": "2", **AVX2}),
    Machine("SSE4.1", {"OMP_NUM_THREADS": "2", **SSE41}),
    Machine("no vectors", {"OMP_NUM_THREADS": "1", **SCALAR}),
    Machine("bf16", {"OMP_NUM_THREADS": "2"}, number_type="bf16"),
)
CUDA = (Machine("CUDA", device="cuda"), Machine("CUDA bf16", number_type="bf16", device="cuda"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuda", action="store_true", help="also check the CUDA device; fails if there is none")
    parser.add_argument(
        "--python", action="append", default=[], help="also check with this interpreter; can be repeated"
    )
    options = parser.parse_args()
    if options.cuda and not torch.cuda.is_available():
        print("conformance: there is no CUDA device on this machine; nothing was checked", file=sys.stderr)
        return 1
    others = tuple(Machine(f"python {path}", {"OMP_NUM_THREADS": "2"}, python=path) for path in options.python)
    machines = (*MACHINES, *others, *(CUDA if options.cuda else ()))
    with tempfile.TemporaryDirectory() as folder:
        facts = run(machines, Path(folder))
        agree = [report(machine, facts[machine.name], Path(folder)) for machine in machines]
    return 0 if all(agree) else 1


def run(machines: tuple[Machine, ...], folder: Path) -> dict[str, dict[str, Any]]:
    """Run all machines one at a time: all encode, then all decode every stream. Returns the output of each by name."""
    children: dict[str, subprocess.Popen[str]] = {}
    facts = {}
    try:
        for machine in machines:
            children[machine.name] = child = start(machine, folder)
            assert child.stdout is not None
            if child.stdout.readline() != "written\n":
                raise SystemExit(f"conformance: {machine.name} failed")
        for name, child in children.items():
            out, _ = child.communicate("go\n")
            if child.returncode != 0:
                raise SystemExit(f"conformance: {name} failed")
            facts[name] = json.loads(out)
    finally:
        for child in children.values():
            child.kill()
    return facts


def start(machine: Machine, folder: Path) -> subprocess.Popen[str]:
    """Start the child process of a machine."""
    script = Path(__file__).with_name("conformance_machine.py")
    return subprocess.Popen(
        [machine.python, script, folder, machine.name.replace("/", "_"), machine.number_type, machine.device],
        # Waiting threads sleep instead of spinning, which matters if there are more threads than cores.
        env={**os.environ, "OMP_WAIT_POLICY": "PASSIVE", **machine.environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def report(machine: Machine, facts: dict[str, Any], folder: Path) -> bool:
    """Print the result, and return whether the Gaussians are within the tolerance of FORMAT.md, section 15."""
    kind = f"torch {facts['torch']}, {facts['capability']}, {facts['threads']} threads, {machine.number_type}"
    print(
        f"{machine.name}: {kind}: {facts['vectors']} vectors and {facts['streams']} streams of all machines, "
        "every symbol the same"
    )
    reference, mine = folder / f"of {MACHINES[0].name}", folder / f"of {machine.name.replace('/', '_')}"
    found = [
        difference((folder / f"{path.stem}.fcs").read_bytes(), rows(path), rows(mine / path.name))
        for path in sorted(reference.glob("*.npy"))
    ]
    worst = Difference.largest(found)
    kind = "full" if machine.number_type == "fp32" and machine.device == "cpu" else "reduced"
    outside = beyond(worst, kind)
    verdict = f"BEYOND the tolerance: {', '.join(outside)}" if outside else "within the tolerance"
    print(f"  Gaussians against {MACHINES[0].name}, {verdict} ({kind}): {worst}", flush=True)
    return not outside


def rows(path: Path) -> torch.Tensor:
    """Read a table of Gaussians, one per row."""
    return torch.from_numpy(np.load(path))


if __name__ == "__main__":
    sys.exit(main())
