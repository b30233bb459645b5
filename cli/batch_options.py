"""Options of the batch commands: where the scenes are processed, and which of them."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import FILE_PATH, json_option, num_threads, parse_shard

if TYPE_CHECKING:
    from fecocodec.batch.run import Engine


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

    options = (
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
    )
    command: Callable[..., int] = with_batch
    for option in reversed(options):
        command = option(command)
    return command


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
    with cluster.local_cluster(options.num_workers or max(1, _num_cores() // of_each), of_each) as engine:
        yield engine


def _num_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
