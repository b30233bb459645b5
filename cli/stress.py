"""`fecosplat stress`: run stress cases through the codec and check a pass criterion (rule) for each."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fecocodec.atomic import make_folder, write_file
from fecocodec.captures.evaluation_index import read_index
from fecocodec.errors import InputError

from .options import FILE_PATH, json_option, lambda_option, model_option, threads_option
from .output import print_columns, print_json, say
from .paths import require_input
from .progress import progress_bar

if TYPE_CHECKING:
    from fecocodec.evaluation.stress.suite import Verdict


@click.command(
    "stress",
    short_help="Run stress cases through the codec and check their rules.",
    epilog="""\b
Examples:
  fecosplat stress scenes/ --index index.json -o results/
  fecosplat stress scenes/ --index index.json -o results/ --most 1 --lambda 1e-4""",
)
@click.argument("root", metavar="ROOT", type=FILE_PATH)
@click.option("--index", required=True, type=FILE_PATH, help="Evaluation index (JSON): context and target frames.")
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Output folder of stress.tsv.")
@click.option(
    "--most",
    type=click.IntRange(min=1),
    default=3,
    help="Maximum number of scenes from the index to derive cases from.",
)
@lambda_option("Rate-distortion trade-off, as in `fecosplat encode`.")
@model_option
@threads_option
@json_option
def command(root: Path, index: Path, output: Path, most: int, lmbda: float, model: Path | None, as_json: bool) -> None:
    """Derive stress cases (dark, blurred, wrong poses, other units, no overlap, mirrors ...) from two-view entries of
    the index and from a synthetic room, and compare each with the unperturbed version of the same scene.

    The exit code is 1 if a rule is violated: a crash, a value that is not finite, a missing warning, more loss than the
    case may have, or 0.5 dB less than photographs as JPEG XL at equal bytes, with our networks at the receiver.
    """
    require_input(root, "there is no such folder; check the path.")
    require_input(index)
    read_index(index)  # reports an invalid index before torch is loaded

    from fecocodec.checkpoint import model_folder
    from fecocodec.evaluation.stress.suite import read_pairs, run_suite
    from fecocodec.evaluation.summary import as_tsv
    from fecocodec.sender.codec import load_codec

    pairs = read_pairs(root, index, most)
    codec = load_codec(model_folder(model), "cpu")
    make_folder(output)
    verdicts = []
    with progress_bar() as on_progress:
        for verdict, fraction in run_suite(codec, pairs, lmbda):
            verdicts.append(verdict)
            on_progress(verdict.case[:24], fraction)
    write_file(output / "stress.tsv", as_tsv(verdicts), overwrite=True)
    if as_json:
        print_json([asdict(verdict) for verdict in verdicts])
    else:
        print_columns([("case", "rule", "PSNR", "lost", "ahead of JPEG XL", "warnings", ""), *map(_row, verdicts)])
    failed = [verdict for verdict in verdicts if not verdict.is_passed]
    say(f"{len(verdicts) - len(failed)} of {len(verdicts)} cases hold")
    if failed:
        raise InputError("; ".join(f"{v.case}: {v.complaint}" for v in failed))


def _row(verdict: "Verdict") -> tuple[str, ...]:
    lost = (verdict.psnr, verdict.lost, verdict.ahead)
    numbers = ("" if value is None else f"{value:.2f}" for value in lost)
    return (verdict.case, verdict.rule, *numbers, f"{verdict.warnings}", verdict.complaint or "holds")
