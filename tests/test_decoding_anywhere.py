"""A stream decodes to the same symbols whatever threads and vector instructions either end had.

The sender computes in floating point, so that two machines may write different streams of one scene. What must hold is
that each stream decodes everywhere: `decode` compares the digest of its symbols with the one in the header.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode
from fecocodec.sender.encode import encode
from tests.example_scenes import MODEL, example_views

ROOT = Path(__file__).resolve().parents[1]
MACHINES = {
    "two threads": {"OMP_NUM_THREADS": "2"},
    "old processor": {"OMP_NUM_THREADS": "1", "ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"},
}
HERE = "here"
RELATIVE_TOLERANCE = 1e-3  # of float32 networks summed in another order; measured: 4e-5

# Encodes (one stage: no kernels to compile), waits until every machine has, then decodes what all have written.
# `test_every_machine_decodes_every_stream` is a third machine, as it is.
MACHINE = """
import sys
from pathlib import Path
root, weights, folder, name, model = sys.argv[1:]
sys.path.insert(0, root)
import torch
from fecocodec.receiver.decode import decode
from fecocodec.sender.encode import encode
from tests.example_scenes import example_views
data = encode(example_views(2, 96, 64), lmbda=1e-4, effort="fast", num_stages=1, model=Path(weights, model))
(Path(folder) / f"{name}.fcs").write_bytes(data)
print("written", flush=True)
sys.stdin.readline()
streams = {path.stem: path.read_bytes() for path in Path(folder).glob("*.fcs")}
options = {"model": Path(weights, model), "background": None, "merging": None}
decoded = {of: decode(data, **options).gaussians.fields() for of, data in streams.items()}
torch.save(decoded, Path(folder) / f"{name}.pt")
"""


@pytest.fixture(scope="module")
def decoded(random_weights: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Gaussians]]:
    """For every machine and here, what it decoded of every machine's stream, and of one with both stages made here."""
    folder = tmp_path_factory.mktemp("machines")
    both_stages = encode(example_views(2, 96, 64), lmbda=1e-4, effort="fast", model=random_weights / MODEL)
    (folder / f"{HERE}.fcs").write_bytes(both_stages)
    children = {
        name: subprocess.Popen(
            [sys.executable, "-c", MACHINE, str(ROOT), str(random_weights), str(folder), name, MODEL],
            env={**os.environ, **limits},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name, limits in MACHINES.items()
    }
    for child in children.values():
        assert child.stdout is not None and child.stdout.readline() == "written\n"
    for child in children.values():
        child.communicate("go\n", timeout=100)
        assert child.returncode == 0
    found = {name: torch.load(folder / f"{name}.pt") for name in MACHINES}
    streams = {path.stem: path.read_bytes() for path in folder.glob("*.fcs")}
    options = {"model": random_weights / MODEL, "background": None, "merging": None}
    found[HERE] = {writer: decode(data, **options).gaussians.fields() for writer, data in streams.items()}
    return {name: {writer: Gaussians(*fields) for writer, fields in by.items()} for name, by in found.items()}


@pytest.mark.timeout(300)  # processes that each load torch
@pytest.mark.parametrize("writer", [HERE, *MACHINES])
def test_every_machine_decodes_every_stream(decoded: dict[str, dict[str, Gaussians]], writer: str) -> None:
    reference = decoded[HERE][writer]
    assert reference.count == 2 * 48 * 32
    for reader in MACHINES:
        for mine, theirs in zip(reference.fields(), decoded[reader][writer].fields(), strict=True):
            largest = float(mine.abs().max()) or 1.0
            assert float((mine - theirs).abs().max()) <= RELATIVE_TOLERANCE * largest
