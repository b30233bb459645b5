"""Run a batch with progress on stderr, list its failures, and write its summary."""

from collections import Counter
from collections.abc import Sequence
from time import monotonic
from typing import TYPE_CHECKING

from fecocodec.batch.scenes import BatchScene, shard_of

from .batch_options import BatchOptions, engine_of
from .output import Verbosity, in_options, print_json, say, verbosity, warn
from .progress import progress_bar
from .terminal import printable

if TYPE_CHECKING:
    from fecocodec.batch.outcome import Outcome
    from fecocodec.batch.scene_task import Work

LISTED_FAILURES = 20  # the summary has all


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
    summary = options.output / summary_name(options.shard)
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


def summary_name(shard: tuple[int, int] | None) -> str:
    """Return the name of the table of outcomes; each shard writes its own."""
    return "summary.tsv" if shard is None else f"summary.{shard[0]}-of-{shard[1]}.tsv"


def _report(outcomes: "Sequence[Outcome]", seconds: float, summary: str, options: BatchOptions) -> None:
    failures = [outcome for outcome in outcomes if outcome.status == "failed"]
    for failure in failures[:LISTED_FAILURES]:
        warn(printable(f"{failure.scene} failed: {failure.error or ''}"))
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
