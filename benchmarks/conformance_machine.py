"""Child process of `conformance.py`: check the golden vectors, encode, wait, and decode the streams of all."""

import json
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
import torch  # noqa: E402

from fecocodec import encode, read_views  # noqa: E402
from fecocodec.receiver.decode import decode  # noqa: E402
from tests.vectors.gaussian_samples import table  # noqa: E402
from tests.vectors.good_vectors import Vector  # noqa: E402
from tests.vectors.make_vectors import EXPECTED, expectation  # noqa: E402
from tests.vectors.tiny_model import VECTORS  # noqa: E402

LAMBDAS = (1e-2, 1e-3, 1e-5)
SIZE = (128, 192)


def main(folder: Path, name: str, number_type: str, device: str) -> None:
    facts: dict[str, Any] = {
        "torch": torch.__version__,
        "threads": torch.get_num_threads(),
        "vectors": check_vectors(),
        "capability": torch.backends.cpu.get_cpu_capability(),
    }
    views = read_views(ROOT / "examples" / "motorcycle", size=SIZE)
    for lmbda in LAMBDAS:
        (folder / f"{name} {lmbda:g}.fcs").write_bytes(encode(views, lmbda=lmbda, device=device))
    print("written", flush=True)
    sys.stdin.readline()
    started = time.perf_counter()
    half = torch.autocast(torch.device(device).type, torch.bfloat16) if number_type == "bf16" else nullcontext()
    streams = sorted(folder.glob("*.fcs"))
    (folder / f"of {name}").mkdir()
    with half:
        for path in streams:
            # Raises if the digest of the symbols does not match, so only floating-point differences remain.
            rows = table(decode(path.read_bytes(), device=device, background=None, merging=None).gaussians)
            np.save(folder / f"of {name}" / f"{path.stem}.npy", rows.float().numpy())
    facts |= {"streams": len(streams), "seconds": time.perf_counter() - started}
    print(json.dumps(facts), flush=True)


def check_vectors() -> int:
    """Check that the valid golden vectors decode to the expected symbols, and return their number.

    Raises AssertionError at the first difference.
    """
    expected = json.loads((VECTORS / EXPECTED).read_text())["good"]
    for name, entry in expected.items():
        assert expectation(Vector((VECTORS / name).read_bytes(), entry["breaks"])) == entry, name
    return len(expected)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
