"""Writes the golden stream of the released model and what must come out of it: `python tests/vectors/make_vectors.py`.

To be run when a model is released, and never to make a failing test pass.
"""

import hashlib
import json
from pathlib import Path

from fecocodec import decode, encode, read_views
from fecocodec.container import read_stream
from fecocodec.geometry.gaussians import Gaussians

ROOT = Path(__file__).parent.parent.parent
VECTORS = ROOT / "bitstream_spec" / "vectors"


def summary(gaussians: Gaussians) -> dict[str, list[float]]:
    """Mean and standard deviation of every field over the Gaussians: what tolerant conformance compares here."""
    return {
        name: [float(statistic) for statistic in (field.double().mean(), field.double().std())]
        for name, field in zip(gaussians.__dataclass_fields__, gaussians.fields(), strict=True)
    }


def expectation(data: bytes) -> dict[str, object]:
    """What a reader must find in a stream: exact facts, then the summary of each stage's Gaussians."""
    stream = read_stream(data)
    decoded = {stage: decode(data, num_stages=stage) for stage in range(1, stream.header.num_stages + 1)}
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "model_id": stream.header.model_id.hex(),
        "symbol_digests": [digest.hex() for digest in stream.header.symbol_digests],
        "num_gaussians": {str(stage): gaussians.count for stage, gaussians in decoded.items()},
        "gaussians": {str(stage): summary(gaussians) for stage, gaussians in decoded.items()},
    }


def main() -> None:
    """Encode the bundled scene and write stream and expectation."""
    data = encode(read_views(ROOT / "examples" / "motorcycle", size=(128, 192)), lmbda=1e-3)
    (VECTORS / "valid").mkdir(parents=True, exist_ok=True)
    (VECTORS / "valid" / "motorcycle.fcs").write_bytes(data)
    (VECTORS / "expected.json").write_text(json.dumps({"valid/motorcycle.fcs": expectation(data)}, indent=1) + "\n")


if __name__ == "__main__":
    main()
