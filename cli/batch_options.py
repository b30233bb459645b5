"""What both batch commands share: which scenes are processed and where, progress, and the report at the end."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import click

from fecocodec.batch.scenes import BatchScene, shard_of
from fecocodec.limits import num_cores

from .options import FILE_PATH, json_option, num_threads, parse_shard, with_options
from .output import Verbosity, in_options, print_json, printable, say, verbosity, warn
from .progress import progress_bar

if TYPE_CHECKING:
    from fecocodec.batch.run import Engine
    from fecocodec.batch.scene_task import Work
    from fecocodec.batch.sidecar import Outcome
LISTED_FAILURES = 20  # the summary has all


@dataclass(frozen=True)
class BatchOptions:
    """Options that both commands have. shard: (number from 1, count). num_workers: None for one per core."""

    output: Path
    scheduler: str | None
    num_workers: int | None
    shard: tuple[int, int] | None
    retry_failed: bool
    overwrite: bool
    as_json: bool

    def __post_init__(self) -> None:
        """Raise UsageError for options that exclude each other."""
        given = [self.scheduler, self.num_workers, self.shard]
        if sum(value is not None for value in given) > 1:
            raise click.UsageError("--scheduler, --workers and --shard exclude each other; give one of them.")


def batch_options(function: Callable[..., int]) -> Callable[..., int]:
    """Add the options; they are passed as one argument, `batch`, of class `BatchOptions`."""

    @wraps(function)
    def with_batch(**values: Any) -> int:
        batch = BatchOptions(**{field.name: values.pop(field.name) for field in fields(BatchOptions)})
        return function(batch=batch, **values)

    return with_options(
        click.option(
            "-o", "--output", required=True, type=FILE_PATH, help="Output folder; an interrupted run is resumed."
        ),
        click.option(
            "--workers",
            "num_workers",
            type=click.IntRange(min=1),
            metavar="NUMBER",
            help="Number of processes on this machine.  [default: one per core, or per --threads cores]",
        ),
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            help="Use the workers of this Dask scheduler, such as tcp://host:8786. They need access to the same paths.",
        ),
        click.option(
            "--shard",
            callback=parse_shard,
            metavar="I/N",
            help="Process the I-th of N parts of the scenes in this process, without Dask, for job arrays.",
        ),
        click.option(
            "--retry-failed", is_flag=True, help="Process scenes again that failed before with the same input."
        ),
        json_option,
    )(with_batch)


@contextmanager
def engine_of(options: BatchOptions) -> "Iterator[Engine]":
    """Yield the engine that the options select. Raises InputError if it is not available."""
    from fecocodec.batch.run import ThisProcess, has_cluster_extra, require_cluster_extra

    if options.shard is not None or (options.num_workers == 1 and not has_cluster_extra()):
        yield ThisProcess()
        return
    require_cluster_extra()
    from fecocodec.batch import cluster

    if options.scheduler is not None:
        with cluster.connected_cluster(options.scheduler) as engine:
            yield engine
        return
    of_each = num_threads(1)
    with cluster.local_cluster(options.num_workers or max(1, num_cores() // of_each), of_each) as engine:
        yield engine


def run_and_report(scenes: Sequence[BatchScene], work: "Work", options: BatchOptions) -> int:
    """Process the scenes, and return the exit code: 1 if any of them failed. Raises FecoError before any work."""
    from fecocodec.batch.run import run_batch, write_summary

    if options.shard is not None:
        scenes = shard_of(scenes, *options.shard)
    start = monotonic()
    outcomes: list[Outcome] = []
    with engine_of(options) as engine, progress_bar() as on_progress:
        results = run_batch(
            scenes,
            options.output,
            work,
            engine,
            overwrite=options.overwrite,
            retry_failed=options.retry_failed,
            phrase=in_options,
        )
        on_progress(f"0 of {len(scenes)} scenes", 0.0)
        begin = monotonic()
        for outcome in results:
            outcomes.append(outcome)
            text = progress_text(outcomes, len(scenes), monotonic() - begin)
            if verbosity() is Verbosity.VERBOSE:
                text = f"{printable(outcome.scene)} {outcome.status}; {text}"
            on_progress(text, len(outcomes) / len(scenes))
    part = "" if options.shard is None else f"{options.shard[0]}-of-{options.shard[1]}."  # each shard has its own
    summary = options.output / f"summary.{part}tsv"
    write_summary(summary, scenes, outcomes)
    _report(outcomes, round(monotonic() - start, 3), str(summary), options)
    return 1 if any(outcome.status == "failed" for outcome in outcomes) else 0


def progress_text(outcomes: "Sequence[Outcome]", total: int, seconds: float) -> str:
    """Return progress, scenes a minute and time left. Skipped scenes take no time and do not count as throughput."""
    text = f"{len(outcomes)} of {total} scenes"
    num_worked = sum(outcome.status != "skipped" for outcome in outcomes)
    if not num_worked or seconds <= 0:
        return text
    left = (total - len(outcomes)) * seconds / num_worked
    return f"{text}, {60 * num_worked / seconds:.1f} a minute, {_duration(left)} left"


def _report(outcomes: "Sequence[Outcome]", seconds: float, summary: str, options: BatchOptions) -> None:
    failures = [outcome for outcome in outcomes if outcome.status == "failed"]
    for failure in failures[:LISTED_FAILURES]:
        warn(f"{failure.scene} failed: {failure.error or ''}")
    if len(failures) > LISTED_FAILURES:
        warn(f"{len(failures) - LISTED_FAILURES} more scenes failed; {summary} lists them")
    if failures and not options.retry_failed:
        say("the next run tries a failed scene again if its input or options have changed, or with --retry-failed")
    count = Counter(outcome.status for outcome in outcomes)
    num_warned = sum(outcome.num_warnings > 0 for outcome in outcomes)
    if options.as_json:
        counts = {status: count[status] for status in ("done", "skipped", "failed")}
        fields = {"scenes": len(outcomes), **counts, "with_warnings": num_warned}
        print_json({**fields, "bytes": sum(outcome.num_bytes or 0 for outcome in outcomes), "seconds": seconds,
                    "summary": summary})  # fmt: skip
        return
    counted = f"{count['done']} done, {count['skipped']} skipped, {count['failed']} failed"
    say(f"{options.output}: {counted} in {_duration(seconds)}; {summary} lists them")
    if num_warned:
        scenes = "scene has" if num_warned == 1 else "scenes have"
        say(f"{num_warned} {scenes} warnings; the .json files hold them")


def _duration(seconds: float) -> str:
    """Return a duration with one unit, such as `90 s`, `12 min` or `5.0 h`."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
