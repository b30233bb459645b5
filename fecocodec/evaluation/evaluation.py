"""Run an evaluation and write its results to a folder: records, averages, comparisons and strips."""

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.atomic import make_folder, write_file
from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE
from fecocodec.errors import InputError, ModelError
from fecocodec.evaluation.extras import require_extra, require_packages
from fecocodec.evaluation.machine import describe_machine
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.paper_tables import complexity_table, quality_charts, read_external
from fecocodec.evaluation.records import Measurement, RecordFile
from fecocodec.evaluation.report.section import write_png
from fecocodec.evaluation.run import Draw, draw_nothing, measure_all
from fecocodec.evaluation.summary import OURS, Average, Comparison, ExternalRow, as_tsv, averages, compare, summary_tsv
from fecocodec.evaluation.systems.groups import lambdas_in_range, systems_of
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.cameras import relative_disparity_from_depth
from fecocodec.geometry.views import Views
from fecocodec.photographs.images import write_image
from fecocodec.sender.codec import Codec, load_codec

ERROR_GAIN = 4.0  # an error of 1/4 has the last colour of the map
MAX_ROWS = 4


def strip(views: Views, num_context: int, found: Reconstruction) -> Float[Tensor, "3 height width"]:
    """Return the comparison image of the first MAX_ROWS target views, sRGB in [0, 1].

    Depth is drawn as disparity, from far (dark, as where nothing is rendered) to near (bright). Raises InputError if
    matplotlib is not installed.
    """
    stop = min(len(views.images), num_context + MAX_ROWS)
    rows = []
    for view in range(num_context, stop):
        error = (found.images[view] - views.images[view]).abs().mean(dim=0) * ERROR_GAIN
        panels = [views.images[view], found.images[view], in_colour(error)]
        if found.depth is not None:
            disparity = relative_disparity_from_depth(found.depth[[view]].clamp_min(1e-12), views.cameras)[0]
            panels.append(in_colour(torch.where(found.depth[view] > 0, disparity, 0.0)))
        rows.append(torch.cat(panels, dim=2))
    return torch.cat(rows, dim=1)


def in_colour(values: Float[Tensor, "height width"]) -> Float[Tensor, "3 height width"]:
    """Map values in [0, 1] to viridis colours. Raises InputError if matplotlib is not installed."""
    colours = require_extra("matplotlib", "drawing strips").colormaps["viridis"](values.clamp(0, 1).numpy())
    return rearrange(torch.from_numpy(colours).float(), "h w rgba -> rgba h w")[:3]


RECORDS = "measurements.jsonl"
SHARD_RECORDS = "measurements_{number}_of_{count}.jsonl"
COMPLEXITY_TABLE = "complexity.md"
STRIP_LAMBDA = 1e-3  # strips are drawn at the nearest measured lambda

OnMeasured = Callable[[Measurement, float], None]  # (measurement, completed fraction of all measurements)


@dataclass(frozen=True)
class Plan:
    """Specification of an evaluation.

    root: folder of scenes or chunks. index: evaluation index (JSON). model: folder of the weights. output: results
    folder. groups: see `systems_of`. size: (height, width) in pixels, None for `protocol_size`. num_context: use only
    entries with this number of context views. most: use at most this many entries, evenly spaced. None: no limit.

    lambdas: None for the usual ones in the range of the model. device: of networks and rendering. shard: (number from
    1, count) to measure a part of the entries, without tables; the same plan without a shard then merges the results.
    external: CSV file with results of other systems, see `read_external`.
    """

    root: Path
    index: Path
    model: Path
    output: Path
    groups: tuple[str, ...]
    lambdas: tuple[float, ...] | None
    size: tuple[int, int] | None = None
    num_context: int | None = None
    most: int | None = None
    with_strips: bool = True
    device: str = "cpu"
    shard: tuple[int, int] | None = None
    external: Path | None = None


@dataclass(frozen=True)
class Report:
    """Results of an evaluation.

    failures: measurements with an error. external: see `Plan`. doubtful: names of entries with warnings.
    """

    averages: tuple[Average, ...]
    comparisons: tuple[Comparison, ...]
    failures: tuple[Measurement, ...]
    external: tuple[ExternalRow, ...] = ()
    doubtful: tuple[str, ...] = ()


def evaluate_to_folder(plan: Plan, on_measured: OnMeasured = lambda _found, _fraction: None) -> Report:
    """Run all measurements that the results folder does not contain yet, and write its tables.

    A scene that fails does not stop the evaluation; it is listed in `Report.failures`. Raises FecoError if nothing can
    be measured.
    """
    require_packages(plan.groups)
    external = () if plan.external is None else read_external(plan.external)
    entries = choose_entries(read_index(plan.index), plan.num_context, plan.most, plan.index)
    if "guided" in plan.groups and not any(entry.guide for entry in entries):
        raise InputError(f"{plan.index}: no entry has `guide`, the frames that teach, which systems `guided` needs.")
    if plan.shard is not None:
        entries = entries[plan.shard[0] - 1 :: plan.shard[1]]
    read = open_scenes(plan.root, plan.size)
    codec = load_codec(plan.model, plan.device)
    lambdas = lambdas_in_range(codec, plan.lambdas)
    systems = systems_of(plan.groups, codec, lambdas)
    make_folder(plan.output)
    records = _records(plan)
    draw = _drawing(plan, lambdas) if plan.with_strips else draw_nothing
    label = weights_label(plan.model, plan.size)
    found, total = [], sum(bool(entry.guide) or system.learn is None for entry in entries for system in systems)
    for measurement in measure_all(read, entries, systems, records, label, draw, plan.device):
        found.append(measurement)
        on_measured(measurement, len(found) / total)
    rows = averages(found)
    failures, doubtful = [m for m in found if m.error], dict.fromkeys(m.entry for m in found if m.warnings)
    report = Report(rows, compare((*rows, *external)), tuple(failures), external, tuple(doubtful))
    if plan.shard is None:
        write_tables(plan.output, found, report)
        _write_paper_tables(plan.output, codec, rows, external)
    return report


def _records(plan: Plan) -> RecordFile:
    """Open the file of a shard; or the main one, which takes over the measurements of all shards."""
    if plan.shard is not None:
        number, count = plan.shard
        return RecordFile(plan.output / SHARD_RECORDS.format(number=number, count=count))
    return RecordFile(plan.output / RECORDS, sorted(plan.output.glob(SHARD_RECORDS.format(number="*", count="*"))))


def _write_paper_tables(folder: Path, codec: Codec, rows: Sequence[Average], external: Sequence[ExternalRow]) -> None:
    """Write `curves_*.png` where matplotlib is installed, and the paper's Table 1."""
    if find_spec("matplotlib") is not None:
        for chart in quality_charts(rows, external):
            write_png(chart, folder / f"{chart.name}.png")
    write_file(folder / COMPLEXITY_TABLE, complexity_table(codec, rows, external), overwrite=True)


def choose_entries(
    entries: Sequence[IndexEntry], num_context: int | None, most: int | None, index: Path
) -> tuple[IndexEntry, ...]:
    """Return the entries with `num_context` context views (None: all), at most `most` of them, evenly spaced.

    index: path for the error message. Raises InputError if no entry has this number of context views.
    """
    chosen = [entry for entry in entries if num_context in (None, len(entry.context))]
    if not chosen:
        of_number = "" if num_context is None else f" with {num_context} context views"
        raise InputError(f"{index}: has no entry{of_number}; add one, or name another index.")
    if most is not None and most < len(chosen):
        chosen = [chosen[round(position * (len(chosen) - 1) / max(1, most - 1))] for position in range(most)]
    return tuple(chosen)


def weights_label(model: Path, size: tuple[int, int] | None) -> str:
    """Return a text that identifies the weights, and the image size if given. Raises ModelError for unreadable ones."""
    try:
        both = [(model / name).read_bytes() for name in (RECEIVER_FILE, SENDER_FILE)]
    except OSError as error:
        raise ModelError(f"{model}: its weights cannot be read ({error.strerror}); name a model's folder.") from error
    digests = "-".join(hashlib.sha256(data).hexdigest()[:16] for data in both)
    return digests + (f"@{size[1]}x{size[0]}" if size else "")


def write_tables(folder: Path, found: Sequence[Measurement], report: Report) -> None:
    """Write `entries.tsv`, `summary.tsv`, `comparisons.tsv` and `summary.json`, each atomically."""
    summary = {
        "machine": describe_machine(),
        "averages": [asdict(row) for row in report.averages],
        "external": [asdict(row) for row in report.external],
        "comparisons": [asdict(row) for row in report.comparisons],
        "failures": [{"entry": m.entry, "system": m.system, "error": m.error} for m in report.failures],
    }
    texts = {
        "entries.tsv": as_tsv(found),
        "summary.tsv": summary_tsv(report.averages, report.external),
        "comparisons.tsv": as_tsv(report.comparisons),
        "summary.json": json.dumps(summary, indent=1),
    }
    for name, text in texts.items():
        write_file(folder / name, text, overwrite=True)


def _drawing(plan: Plan, lambdas: Sequence[float]) -> Draw:
    folder = plan.output / "strips"
    make_folder(folder)
    drawn = min(lambdas, key=lambda lmbda: abs(math.log(lmbda / STRIP_LAMBDA)))

    def draw(entry: IndexEntry, system: System, views: Views, found: Reconstruction) -> None:
        if (system.name, system.setting) == (OURS, f"lambda {drawn:g}"):
            name = f"{entry.name.replace('/', '_')}.png"
            write_image(folder / name, strip(views, len(entry.context), found), overwrite=True)

    return draw
