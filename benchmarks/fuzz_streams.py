"""Fuzz the decoder with mutated streams (`make fuzz`).

    python benchmarks/fuzz_streams.py --files 1000000
    python benchmarks/fuzz_streams.py --minutes 10

Every stream must decode or raise one of the library's errors, within two seconds of CPU time and one GiB of additional
memory. Streams that violate this are saved to out/fuzz/, and the exit code is 1.
"""

import argparse
import hashlib
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import torch  # noqa: E402

from tests.fuzzing.mutations import corpus, random_mutant  # noqa: E402
from tests.fuzzing.verdicts import EVERY_VERDICT, verdict  # noqa: E402

MOST_SECONDS = 2.0
MOST_BYTES = 1 << 30
FOUND = ROOT / "out" / "fuzz"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=sys.maxsize, help="stop after this number of streams")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("--seed", type=int, default=0, help="seed of random numbers  [default: 0]")
    options = parser.parse_args()
    if options.files == sys.maxsize and options.minutes == float("inf"):
        parser.error("give --files or --minutes")
    torch.set_num_threads(1)
    for data in corpus():
        verdict(data)  # load tables and the model before memory is limited
    bound_memory()
    counts, slowest = Counter[str](), 0.0
    for number, data in enumerate(mutants(options.seed, options.files, options.minutes), 1):
        started = time.process_time()
        found = judge(data)
        seconds = time.process_time() - started
        slowest = max(slowest, seconds)
        found = "slow" if seconds > MOST_SECONDS else found
        counts[found] += 1
        if found not in EVERY_VERDICT:
            keep(data, found)
        if number % 20000 == 0:
            print(f"{number} files: {dict(counts)}, slowest {slowest:.3f} s", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{counts.total()} files: {dict(counts)}, slowest {slowest:.3f} s, peak memory of the process {peak:.0f} MiB")
    return 0 if counts.keys() <= set(EVERY_VERDICT) else 1


def bound_memory() -> None:
    """Limit the address space to MOST_BYTES more than now. A larger allocation raises MemoryError, a finding."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def mutants(seed: int, files: int, minutes: float) -> Iterator[bytes]:
    """Yield mutated streams until one of the limits is reached."""
    random, end = Random(seed), time.monotonic() + 60 * minutes
    for _ in range(files):
        if time.monotonic() > end:
            return
        yield random_mutant(random, corpus())


def judge(data: bytes) -> str:
    """Return the verdict on a stream, or the unexpected exception as text."""
    try:
        return verdict(data)
    except Exception as error:  # any other exception is a finding
        return f"{type(error).__name__}: {error}"


def keep(data: bytes, found: str) -> None:
    """Save a stream and its verdict to out/fuzz/, named by its digest."""
    FOUND.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(data).hexdigest()[:16]
    (FOUND / f"{name}.fcs").write_bytes(data)
    (FOUND / f"{name}.txt").write_text(found + "\n")


if __name__ == "__main__":
    sys.exit(main())
