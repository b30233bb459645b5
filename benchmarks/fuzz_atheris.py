"""Coverage-guided fuzzing of the container parsers with atheris (`make fuzz`).

    python benchmarks/fuzz_atheris.py -max_total_time=300

Options are those of libFuzzer. Half of the mutated files get recomputed checksums, to reach the code behind the checks.
"""

import sys
import tempfile
from pathlib import Path
from random import Random

import atheris

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

with atheris.instrument_imports(include=["fecocodec.container"]):
    from fecocodec.container import inspect, read_intact, read_prefix, read_stream
    from fecocodec.errors import BitstreamError, InputError

from tests.fuzzing.mutations import corpus, sealed  # noqa: E402

READERS = (read_stream, read_intact, inspect, lambda data: read_prefix(data, 1), lambda data: read_prefix(data, 2))


def read_all(data: bytes) -> None:
    """Run all parsers on the data."""
    for read in READERS:
        try:
            read(data)
        except (BitstreamError, InputError):
            continue  # expected; any other exception ends the run


def change(data: bytes, most: int, seed: int) -> bytes:
    """Mutate with libFuzzer; recompute the checksums with probability 1/2."""
    changed = atheris.Mutate(data, most)
    return sealed(bytearray(changed))[:most] if Random(seed).random() < 0.5 else changed


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(corpus()):
            (Path(folder) / f"{number}").write_bytes(data)
        limits = ["-timeout=2", "-rss_limit_mb=1024", "-max_len=4096"]
        atheris.Setup([sys.argv[0], *limits, *sys.argv[1:], folder], read_all, custom_mutator=change)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
