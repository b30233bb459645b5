"""Measure rate, PSNR, SSIM, ST-LPIPS and LPIPS (VGG16) on an evaluation index, from encoded and decoded bytes.

python benchmarks/dev_scores.py MODEL_FOLDER ROOT INDEX.json [--lambdas 1e-2 1e-4] [--views 2] [--effort best]
    [--sharpness 0.5] [--device cuda]
"""

import argparse
from pathlib import Path
from statistics import mean

from fecocodec.captures.evaluation_index import read_index
from fecocodec.errors import FecoError, InputError
from fecocodec.evaluation.evaluation import choose_entries
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.section import number
from fecocodec.evaluation.run import evaluate
from fecocodec.evaluation.summary import averages
from fecocodec.evaluation.systems.codec import codec_system, guided_system
from fecocodec.sender.codec import load_codec
from fecocodec.sender.optimisation_config import EFFORTS


def main() -> None:
    """Print one line per lambda: means over entries, then the mean PSNR by kind of entry (name without digits)."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="folder of the weights")
    parser.add_argument("root", type=Path, help="folder with one folder per scene")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--lambdas", type=float, nargs="+", default=[1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5])
    parser.add_argument("--views", type=int, default=2, help="number of context views of the entries  [default: 2]")
    parser.add_argument("--stages", type=int, default=2, help="number of stages  [default: 2]")
    parser.add_argument("--effort", choices=EFFORTS, default="default", help="as for `fecosplat encode`")
    parser.add_argument("--sharpness", type=float, default=0.0, help="as for `fecosplat encode`")
    parser.add_argument("--guided", action="store_true", help="let guides teach; only entries that have them")
    parser.add_argument("--size", type=int, default=256, help="image side in pixels  [default: 256]")
    parser.add_argument("--device", default="cpu", help="as for `fecosplat encode`  [default: cpu]")
    arguments = parser.parse_args()
    entries = choose_entries(read_index(arguments.index), arguments.views, None, arguments.index)
    if arguments.guided and not (entries := tuple(entry for entry in entries if entry.guide)):
        raise InputError(f"{arguments.index}: no entry with {arguments.views} views has `guide`; leave out --guided.")
    codec = load_codec(arguments.model, arguments.device)
    size = (arguments.size, arguments.size)
    print("lambda\tKiB\tPSNR\tSSIM\tST-LPIPS\tLPIPS\tcontext PSNR\tGaussians\tby kind")
    for lmbda in arguments.lambdas:
        if arguments.guided:
            system = guided_system(codec, lmbda, arguments.stages, arguments.effort)
        else:
            system = codec_system(codec, lmbda, arguments.stages, arguments.effort, arguments.sharpness)
        (row,) = averages(found := list(evaluate(system, arguments.root, entries, size)))
        print(
            f"{lmbda:g}\t{row.kib:.2f}\t{row.psnr:.2f}\t{row.ssim:.3f}\t{number(row.st_lpips, 4)}\t"
            f"{number(row.lpips, 4)}\t{row.context_psnr:.2f}\t{row.gaussians:.0f}\t{_by_kind(found)}",
            flush=True,
        )


def _by_kind(found: list[Measurement]) -> str:
    kinds: dict[str, list[float]] = {}
    for measurement in found:
        kinds.setdefault(measurement.entry.split("/")[-1].rstrip("0123456789"), []).append(measurement.psnr)
    return " ".join(f"{kind} {mean(values):.2f}" for kind, values in kinds.items())


if __name__ == "__main__":
    try:
        main()
    except FecoError as error:
        raise SystemExit(str(error)) from error
