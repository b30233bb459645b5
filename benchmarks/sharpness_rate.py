"""Compare files of several values of `encode --sharpness` with each other and with compressed photographs, by BD-rate.

    python benchmarks/sharpness_rate.py MODEL_FOLDER ROOT INDEX.json out/report/measurements.jsonl [--entries 12]

The last file is that of `make report`, for the curves of compressed photographs. Prints BD-rate in percent by PSNR and
by ST-LPIPS of target views, from encoded and decoded files of the pairs that the report measures.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from statistics import fmean

from fecocodec.captures.evaluation_index import read_index
from fecocodec.evaluation.bd_rate import Point, bd_rate
from fecocodec.evaluation.evaluation import choose_entries
from fecocodec.evaluation.novel_views import evaluate
from fecocodec.evaluation.records import RecordFile
from fecocodec.evaluation.systems.codec import codec_system
from fecocodec.sender.codec import load_codec

SHARPNESS, LAMBDAS, SIZE = (-1.0, 0.0, 1.0), (1e-2, 3e-3, 1e-3, 1e-4), 256
ANCHORS = ("AVIF", "AVIF, optimised at the receiver", "WebP", "JPEG XL", "JPEG")

Row = tuple[float, float, float]  # bytes, PSNR, ST-LPIPS


def curves(settings: Iterable[list[Row]]) -> tuple[list[Point], list[Point]]:
    """Return mean bytes against PSNR and against -ST-LPIPS; one point for each setting."""
    means = [tuple(map(fmean, zip(*rows, strict=True))) for rows in settings]
    return [(size, psnr) for size, psnr, _ in means], [(size, -distance) for size, _, distance in means]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("model", "root", "index", "measurements"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--entries", type=int, default=12, help="number of pairs, as for the report  [default: 12]")
    arguments = parser.parse_args()
    codec = load_codec(arguments.model, "cpu")
    entries = choose_entries(read_index(arguments.index), 2, arguments.entries, arguments.index)
    names, records = {entry.name for entry in entries}, RecordFile(arguments.measurements)
    of_system = {}
    for system in ANCHORS:
        rows: dict[str, list[Row]] = defaultdict(list)
        for found in records.select(lambda it, name=system: it.system == name and it.entry in names):  # type: ignore[misc]
            if found.height == SIZE and found.st_lpips is not None:
                rows[found.setting].append((found.num_bytes, found.psnr, found.st_lpips))
        of_system[system] = curves(rows.values())
    for sharpness in SHARPNESS:
        systems = [codec_system(codec, lmbda, sharpness=sharpness) for lmbda in LAMBDAS]
        scores = [list(evaluate(system, arguments.root, entries, (SIZE, SIZE))) for system in systems]
        own = curves([[(s.num_bytes, s.target_psnr, s.target_st_lpips) for s in of_lambda] for of_lambda in scores])
        for anchor, other in of_system.items():
            rates = [bd_rate(theirs, ours) for theirs, ours in zip(other, own, strict=True)]
            shown = " / ".join("-" if rate is None else f"{rate:+.1f}%" for rate in rates)
            print(f"sharpness {sharpness:g} against {anchor}: {shown}", flush=True)
        of_system[f"sharpness {sharpness:g}"] = own


if __name__ == "__main__":
    main()
