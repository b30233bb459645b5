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
OTHER = {"OMP_NUM_THREADS": "2", "ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"}
OTHER |= {"MKL_ENABLE_INSTRUCTIONS": "SSE4_2"}
RELATIVE_TOLERANCE = 1e-3  # of float32 networks summed in another order; measured: 4e-5

# Encodes one stage, which needs no kernels to be compiled, and decodes this stream and one that was made here.
MACHINE = """
import sys
from pathlib import Path
root, model, folder = sys.argv[1:]
sys.path.insert(0, root)
import torch
from fecocodec.receiver.decode import decode
from fecocodec.sender.encode import encode
from tests.example_scenes import example_views
options = {"model": Path(model), "background": None, "merging": None}
own = encode(example_views(2, 96, 64), lmbda=1e-4, effort="fast", num_stages=1, model=Path(model))
(Path(folder) / "own").write_bytes(own)
streams = (Path(folder) / "here").read_bytes(), own
torch.save([decode(data, **options).gaussians.fields() for data in streams], Path(folder) / "decoded")
"""


@pytest.mark.timeout(300)  # a process that loads torch
def test_every_machine_decodes_every_stream(random_weights: Path, tmp_path: Path) -> None:
    """Here, and as on an old processor with two threads."""
    model = random_weights / MODEL
    both_stages = encode(example_views(2, 96, 64), lmbda=1e-4, effort="fast", model=model)
    (tmp_path / "here").write_bytes(both_stages)
    command = [sys.executable, "-c", MACHINE, str(ROOT), str(model), str(tmp_path)]
    subprocess.run(command, env={**os.environ, **OTHER}, check=True, timeout=100)
    found = torch.load(tmp_path / "decoded")
    for data, theirs in zip((both_stages, (tmp_path / "own").read_bytes()), found, strict=True):
        mine = decode(data, model=model, background=None, merging=None).gaussians
        assert mine.count == Gaussians(*theirs).count == 2 * 48 * 32
        for ours, other in zip(mine.fields(), theirs, strict=True):
            assert float((ours - other).abs().max()) <= RELATIVE_TOLERANCE * (float(ours.abs().max()) or 1.0)
