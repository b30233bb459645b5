"""Test the detection of corrupted payloads: `python benchmarks/flip_payloads.py --flips 10000`.

Single bits and bursts of up to 64 bits are flipped in the coded latents of the golden vectors. The test runs twice:
with the original checksums, and with recomputed checksums, which leaves only the final state of the coder and the
digest to detect the error. No corrupted stream may decode to other symbols without an error.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from fecocodec.container import read_stream  # noqa: E402
from fecocodec.errors import BitstreamError  # noqa: E402
from tests.fuzzing.mutations import VECTORS, sealed, section_starts  # noqa: E402
from tests.vectors.symbols import decode_symbols  # noqa: E402

NOTICED_BY = {
    "CRC-32": "checksum",
    "32-bit words": "form of the payload",
    "escape": "range of an escape",
    "in magnitude": "range of a symbol",
    "end together": "end of the coder",
    "digest": "digest",
}
PAYLOAD_KINDS = (0xA0, 0xB0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=10_000, help="number of corrupted streams  [default: 10000]")
    parser.add_argument("--seed", type=int, default=0, help="seed of random numbers  [default: 0]")
    options = parser.parse_args()
    files = [path for folder in ("valid", "uncommon") for path in sorted((VECTORS / folder).glob("*.fcs"))]
    # One flip in twenty is in a scene of a released model, which takes a hundred times as long as the others.
    small = [path.read_bytes() for path in files if not path.stem.startswith("scene-") and path.stat().st_size < 4000]
    scenes = [path.read_bytes() for path in files if path.stem.startswith("scene-")]
    wrong = 0
    for seals, what in ((False, "as they are"), (True, "under checksums that hold")):
        counts = Counter(outcomes(small, scenes, options.flips, Random(options.seed), seals))
        wrong += counts["NOT NOTICED"]
        print(f"{options.flips} flips {what}: {dict(counts.most_common())}", flush=True)
    return 1 if wrong else 0


def outcomes(small: list[bytes], scenes: list[bytes], flips: int, random: Random, seals: bool) -> Iterator[str]:
    """Yield the outcome of each flip. seals: whether checksums are recomputed after the flip."""
    for number in range(flips):
        streams = scenes if number % 20 == 0 else small
        data = streams[int(random.random() * len(streams))]
        changed = flipped(data, random)
        yield outcome(data, sealed(bytearray(changed)) if seals else changed)


def flipped(data: bytes, random: Random) -> bytes:
    """Flip a single bit or, with probability 1/2, a random pattern of up to 64 bits, within one payload."""
    payloads = [
        (start + 9, start + 9 + int.from_bytes(data[start + 1 : start + 5], "little"))
        for start in section_starts(data)
        if data[start] in PAYLOAD_KINDS
    ]
    begin, end = payloads[int(random.random() * len(payloads))]
    width = 1 if random.random() < 0.5 else 2 + int(random.random() * 63)
    pattern = 1 | int(random.random() * 2**width) | 1 << width - 1
    shift = int(random.random() * max(1, 8 * (end - begin) - width))
    value = int.from_bytes(data[begin:end], "little") ^ pattern << shift
    return data[:begin] + (value % (1 << 8 * (end - begin))).to_bytes(end - begin, "little") + data[end:]


def outcome(original: bytes, changed: bytes) -> str:
    """Decode the corrupted stream, and return what detected the error, "same symbols" or "NOT NOTICED"."""
    try:
        found = decode_symbols(read_stream(changed))
    except BitstreamError as error:
        return next((name for text, name in NOTICED_BY.items() if text in str(error)), str(error))
    wanted = decode_symbols(read_stream(original))
    same = all(
        (a == b).all()
        for mine, theirs in zip(found, wanted, strict=True)
        for a, b in zip(mine.batches, theirs.batches, strict=True)
    )
    return "same symbols" if same else "NOT NOTICED"


if __name__ == "__main__":
    sys.exit(main())
