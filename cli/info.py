"""`fecosplat info`: describe the contents of a .fcs file, or count the parameters of the networks."""

from dataclasses import asdict
from pathlib import Path

import click

from fecocodec.container import Header, StreamSummary, inspect, read_stream_file
from fecocodec.container.metadata import Metadata
from fecocodec.errors import BitstreamError, error_context

from .options import METADATA, STREAM_PATH, json_option
from .output import in_options, print_columns, print_fields, print_json, printable

_CONTENTS = {
    "cameras": "of the coded views",
    "coverage": "cells of the views that are not transparent",
    "fading": "parts of the views whose Gaussians are fainter, because they hide what other views show",
    "B1": "stage 1: a coarse version of the scene",
    "B2": "stage 2: corrections to stage 1",
    "detail": "changes of the Gaussians beyond what the stages hold",
    "metadata": "title, author, licence and date",
}
GIB_OF_PROGRAM, GIB_PER_MEGAPIXEL = 0.4, 0.25  # memory of `decode`: linear fit to 0.1 to 16 megapixels


@click.command(
    "info",
    short_help="Describe a .fcs file, or count the networks' parameters.",
    epilog="""\b
Examples:
  fecosplat info scene.fcs
  fecosplat info scene.fcs --json
  fecosplat info --parameters paper""",
)
@click.argument("stream", metavar="[FILE.fcs]", required=False, type=STREAM_PATH)
@click.option(
    "--parameters",
    "profile",
    type=click.Choice(["compact", "paper", "paper-large"]),
    is_flag=False,
    flag_value="compact",
    help="Show the number of parameters of each module, at the sender and at the receiver. Without a value: compact.",
)
@json_option
def command(stream: Path | None, profile: str | None, as_json: bool) -> None:
    """Show the views and stages of FILE.fcs (- for standard input), and the size of each section.

    A damaged file is described as far as possible; the exit code is then 1.
    """
    if profile is not None and stream is None:
        return _print_parameters(profile, as_json)
    if profile is not None or stream is None:
        raise click.UsageError("Give either a .fcs file or --parameters.")
    data = read_stream_file(stream)
    with error_context(stream):
        summary = inspect(data)
        if as_json:
            print_json(summary_fields(summary))
        else:
            print_summary(summary)
        if summary.damage:
            raise BitstreamError(summary.damage)


def summary_fields(summary: StreamSummary) -> dict[str, object]:
    """Return the summary as a JSON object. Its keys are part of the public interface of the command line."""
    header = summary.header
    return {
        "format_version": f"{header.version.major}.{header.version.minor}",
        "model_id": header.model_id.hex(),
        "views": header.num_views,
        "height": header.height,
        "width": header.width,
        "lambda": float(f"{header.lambda_of_stage(2):.4g}"),
        "stage_1_lambda": float(f"{header.lambda_of_stage(1):.4g}"),
        "stages": header.num_stages,
        "near": summary.near,
        "far": summary.far,
        "bytes": summary.total_bytes,
        "bits_per_pixel": summary.bits_per_pixel,
        "header_bytes": summary.header_bytes,
        "overhead_bytes": summary.overhead_bytes,
        "sections": [
            {
                "name": section.name,
                "offset": section.offset,
                "payload_bytes": section.length,
                "intact": section.is_intact,
            }
            for section in summary.sections
        ],
        "symbol_digests": [digest.hex() for digest in header.symbol_digests],
        "covered": summary.covered,
        "decoding": {"pixels": header.num_pixels, "gib": round(decoding_gib(header), 2)},
        "metadata": summary.metadata,
        "damage": None if summary.damage is None else in_options(summary.damage),
    }


def print_summary(summary: StreamSummary) -> None:
    """Print the summary as text: fields, then a table of sections with their offsets and sizes."""
    header = summary.header
    depth = "unknown" if summary.near is None or summary.far is None else f"{summary.near:.6g} to {summary.far:.6g}"
    print_fields(
        [
            ("format", f"{header.version.major}.{header.version.minor}"),
            ("model", header.model_id.hex()),
            ("views", f"{header.num_views} of {header.width}x{header.height}"),
            ("depth", depth),
            ("lambda", _lambda(header, has_detail=any(section.name == "detail" for section in summary.sections))),
            ("stages", f"{header.num_stages}"),
            *([] if summary.covered is None else [("covered", f"{100 * summary.covered:.1f}% of the views")]),
            ("size", f"{summary.total_bytes:,} bytes, {summary.bits_per_pixel:.4f} bits per pixel"),
            *_described(summary.metadata),
            (
                "decoding",
                f"{header.num_pixels:,} pixels in all (sides rounded to multiples of 32), about "
                f"{decoding_gib(header):.1f} GiB of memory",
            ),
        ]
    )
    rows = [
        (f"{s.offset}", s.name, f"{s.total_bytes}", _CONTENTS.get(s.name, "") if s.is_intact else "damaged")
        for s in summary.sections
    ]
    header_row = ("0", "header", f"{summary.header_bytes}", "model, sizes, lambda")
    # An empty line first, written where errors of stdout are caught.
    print_columns([("", "", "", ""), ("at byte", "section", "bytes", ""), header_row, *rows])


def _described(metadata: Metadata | None) -> list[tuple[str, str]]:
    """Return the text fields of the metadata that `encode` writes, with control characters escaped."""
    values = [(name, (metadata or {}).get(name)) for name in METADATA]
    return [(name, printable(value)) for name, value in values if isinstance(value, str)]


def _lambda(header: Header, *, has_detail: bool) -> str:
    """Return lambda of each stage with its meaning. Stage 1 has a larger one, to fewer bytes, because stage 2 follows.

    With detail, the last stage may be coded at a larger lambda than the user's, which the file does not hold.
    """
    stages = range(1, header.num_stages + 1)
    values = ", ".join(f"{header.lambda_of_stage(stage):.4g} in stage {stage}" for stage in stages)
    detail = "; the --lambda that was given may be smaller, because detail follows" if has_detail else ""
    return f"{values} (a larger one gives a smaller, coarser file{detail})"


def decoding_gib(header: Header) -> float:
    """Return the estimated peak memory of decoding, in GiB."""
    return GIB_OF_PROGRAM + GIB_PER_MEGAPIXEL * header.num_pixels / 2**20


def _print_parameters(profile: str, as_json: bool) -> None:
    """Print the parameters of each module, then the totals of `decode` and `encode`, beside those of the paper."""
    from fecocodec.sender.parameters import PUBLISHED, parameter_table

    table = parameter_table(profile)
    published = PUBLISHED.get(profile, {})
    if as_json:
        of_paper = ({"published": published[row.module]} if row.module in published else {} for row in table)
        print_json([asdict(row) | more for row, more in zip(table, of_paper, strict=True)])
        return
    lines = [("module", "side", "parameters", "paper's Table 1")]
    for row in table:
        total = published.get(row.module)
        beside = "" if total is None else f"{total / 1e6:.2f} M ({100 * (row.parameters / total - 1):+.2f}%)"
        lines.append((row.module, row.side, f"{row.parameters:,}", beside))
    print_columns(lines if published else [line[:3] for line in lines])
