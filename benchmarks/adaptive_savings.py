"""What `--adaptive` saves on every pair of an index: files against plain ones at equal PSNR of target views.

python benchmarks/adaptive_savings.py MODEL_FOLDER ROOT INDEX.json [--work out/adaptive]

`make report` says the same of a dozen pairs, whose simplest third is four: too few where curves are flat. A run that
was interrupted goes on where it stopped; 31 pairs take half an hour of two cores.
"""

import argparse
from pathlib import Path

from fecocodec.evaluation.complexity import photograph_kib
from fecocodec.evaluation.entries import open_scenes
from fecocodec.evaluation.evaluation import RECORDS, choose_entries, weights_label
from fecocodec.evaluation.records import RecordFile
from fecocodec.evaluation.report.adaptive_section import bytes_saved
from fecocodec.evaluation.run import measure_all
from fecocodec.evaluation.summary import averages
from fecocodec.evaluation.systems import systems_of
from fecocodec.formats.atomic import make_folder
from fecocodec.formats.evaluation_index import read_index
from fecocodec.sender.encode import load_profile

LAMBDAS = (1e-2, 1e-3, 1e-4)  # as in the report


def main() -> None:
    """Measure what is missing; print the mean over pairs of every system, then the table by thirds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("model", "root", "index"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--work", type=Path, default=Path("out/adaptive"), help="results, kept for the next time")
    arguments = parser.parse_args()
    make_folder(arguments.work)
    pairs = choose_entries(read_index(arguments.index), 2, None, arguments.index)
    read = open_scenes(arguments.root)
    systems = systems_of(["codec", "adaptive"], load_profile(arguments.model, "cpu"), LAMBDAS)
    records = RecordFile(arguments.work / RECORDS)
    found = tuple(measure_all(read, pairs, systems, records, weights_label(arguments.model, None)))
    complexity = {pair.name: photograph_kib(read(pair).select(list(range(len(pair.context))))) for pair in pairs}
    for row in averages(found):
        print(f"{row.system}\t{row.setting}\t{row.kib:.2f} KiB\t{row.psnr:.2f} dB")
    print(f"\n{bytes_saved(found, complexity)}")
    if failures := [f"{m.entry}, {m.system}, {m.setting}: {m.error}" for m in found if m.error]:
        raise SystemExit("\n".join(failures))


if __name__ == "__main__":
    main()
