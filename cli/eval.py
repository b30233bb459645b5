"""`fecosplat eval`: measure rate and quality of the codec, and of alternatives, on an evaluation index."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fecocodec.captures.evaluation_index import read_index
from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError, some_of

from .options import (
    FILE_PATH,
    device_option,
    json_option,
    model_option,
    parse_shard,
    parse_size,
    parsed,
    threads_option,
)
from .output import print_columns, print_json, say, warn
from .paths import require_input
from .progress import progress_bar

if TYPE_CHECKING:
    from fecocodec.evaluation.evaluation import Report
    from fecocodec.evaluation.summary import RatedPoint

DEFAULT_LAMBDAS = "1e-2,3e-3,1e-3,3e-4,1e-4,1e-5"


@parsed
def parse_lambdas(value: str) -> tuple[float, ...]:
    """Parse comma-separated numbers. The library checks that each is a valid lambda."""
    try:
        return tuple(float(number) for number in value.split(","))
    except ValueError as error:
        raise ValueError(f"{value!r} is not numbers with commas between, such as 1e-2,1e-4.") from error


@click.command(
    "eval",
    short_help="Measure rate and quality on scenes with target views.",
    epilog="""\b
Examples:
  fecosplat eval scenes/ --index index.json -o results/
  fecosplat eval scenes/ --index index.json -o results/ --systems codec,images --most 8
  fecosplat eval re10k/test --index evaluation_index_re10k.json -o results/ --lambdas 1e-2,1e-4""",
)
@click.argument("root", metavar="ROOT", type=FILE_PATH)
@click.option("--index", required=True, type=FILE_PATH, help="Evaluation index (JSON): context, target, guide.")
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Results folder; an interrupted run is resumed.")
@click.option(
    "--lambdas",
    callback=parse_lambdas,
    metavar="LIST",
    help=f"Comma-separated values of lambda to measure.  [default: those of {DEFAULT_LAMBDAS} that the model is for]",
)
@click.option(
    "--systems",
    "groups",
    default="codec",
    metavar="LIST",
    help="Comma-separated systems to measure: codec; guided (guides of the index teach it); fast and best (other "
    "efforts); ablations (or one of stage-1, no-context, no-feedback); images (compressed photographs); gaussians "
    "(compressed Gaussians); trivial.",
)
@model_option
@click.option(
    "--views", "num_context", type=click.IntRange(min=1), help="Use only entries with this number of context views."
)
@click.option("--most", type=click.IntRange(min=1), help="Use at most this many entries, evenly spaced over the index.")
@click.option(
    "--size",
    callback=parse_size,
    metavar="WxH",
    help="Centre-crop and resize all views to this size.  [default: 256x256 for up to two context views, else 448x256]",
)
@click.option(
    "--strips/--no-strips",
    default=True,
    help="Write an image per entry with target, decoded view, error and depth side by side.",
)
@click.option(
    "--shard",
    callback=parse_shard,
    metavar="I/N",
    help="Measure part I of N of the entries. The same command without it then merges the parts and writes the tables.",
)
@click.option(
    "--external", type=FILE_PATH, metavar="CSV", help="Results of other systems, drawn and listed beside ours."
)
@device_option
@threads_option
@json_option
def command(
    root: Path,
    index: Path,
    output: Path,
    lambdas: tuple[float, ...] | None,
    groups: str,
    model: Path | None,
    num_context: int | None,
    most: int | None,
    size: tuple[int, int] | None,
    strips: bool,
    shard: tuple[int, int] | None,
    external: Path | None,
    device: str,
    as_json: bool,
) -> None:
    """Encode the context views of every entry of the index, decode the file, and compare renderings with the target
    views.

    ROOT contains one folder per scene (transforms.json, COLMAP), or RealEstate10K, ACID or DL3DV chunks in the format
    of pixelSplat. The rate is the size of the whole file. Results are written to entries.tsv, summary.tsv,
    comparisons.tsv, summary.json, complexity.md (the paper's Table 1), curves_*.png and strips/. An interrupted run
    resumes where it stopped. Scenes that fail are listed at the end.
    """
    for lmbda in lambdas or ():
        quantise_lambda(lmbda)  # raises for a value outside the range, before anything is read

    from fecocodec.evaluation.extras import require_packages

    names = tuple(group.strip() for group in groups.split(","))
    require_packages(names)
    require_input(root, "there is no such folder; check the path.")
    require_input(index)
    read_index(index)  # reports an invalid index before torch is loaded

    from fecocodec.checkpoint import model_folder
    from fecocodec.evaluation.evaluation import Plan, evaluate_to_folder
    from fecocodec.rendering.cuda import require_rendering_device

    require_rendering_device(device)
    plan = Plan(
        root, index, model_folder(model), output, names, lambdas, size, num_context, most,
        with_strips=strips, device=device, shard=shard, external=external,
    )  # fmt: skip
    with progress_bar() as on_progress:
        report = evaluate_to_folder(plan, lambda m, fraction: on_progress(f"{m.entry} {m.system}"[:24], fraction))
    if as_json:
        averages, others = ([asdict(row) for row in rows] for rows in (report.averages, report.external))
        print_json({"averages": averages, "external": others, "output": str(output)})
    else:
        _print_report(report)
    if (entries := report.doubtful) and shard is None:
        place = output / "entries.tsv"
        warn(f"{place}: warnings at {len(entries)} of the entries ({some_of(entries)}); see its column `warnings`.")
    if report.failures:
        for failure in report.failures:
            warn(f"{failure.entry}, {failure.system}, {failure.setting}: {failure.error}")
        raise InputError(f"{output}: {len(report.failures)} measurements failed, the others are there; see above.")


_COLUMNS = {
    "KiB": ("kib", ".2f"),
    "bpp": ("bits_per_pixel", ".3f"),
    "PSNR": ("psnr", ".2f"),
    "SSIM": ("ssim", ".3f"),
    "FLIP": ("flip", ".3f"),
    "ST-LPIPS": ("st_lpips", ".3f"),
    "LPIPS": ("lpips", ".3f"),
    "LPIPS (AlexNet)": ("lpips_alex", ".3f"),
    "Gaussians": ("gaussians", ".0f"),
    "encode s": ("encode_seconds", ".3f"),
    "decode s": ("decode_seconds", ".3f"),
}


def _cells(row: "RatedPoint") -> tuple[str, ...]:
    values = ((getattr(row, name, None), digits) for name, digits in _COLUMNS.values())
    cells = ("" if value is None else format(value, digits) for value, digits in values)
    return row.system, row.setting, str(getattr(row, "entries", "external")), *cells


def _print_report(report: "Report") -> None:
    from fecocodec.evaluation.summary import LEAST_OVERLAP_DB, NO_LPIPS

    rows: tuple[RatedPoint, ...] = (*report.averages, *report.external)
    if rows:
        print_columns([("system", "setting", "entries", *_COLUMNS), *map(_cells, rows)])
    if report.averages and all(row.lpips is None for row in report.averages):
        say(NO_LPIPS)
    for found in report.comparisons:
        none = f"less than {LEAST_OVERLAP_DB:g} dB of PSNR in common"
        rate = none if found.bd_rate is None else f"{found.bd_rate:+.1f}% bytes at equal PSNR"
        gain = "no common rate" if found.bd_psnr is None else f"{found.bd_psnr:+.2f} dB at equal bytes"
        say(f"fecosplat against {found.baseline}: {rate}, {gain}")
