"""The work on one scene of a batch: skip it, or make its output and sidecar, or record its failure."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from traceback import format_exception
from typing import Any, Protocol, runtime_checkable

from fecocodec import __version__
from fecocodec.atomic import write_file
from fecocodec.batch.scenes import BatchScene
from fecocodec.batch.sidecar import (
    ForeignFileError,
    Inputs,
    Outcome,
    Record,
    Status,
    as_stored,
    outcome_of,
    read_sidecar,
    write_sidecar,
)
from fecocodec.errors import FecoError, InputError, OutputError
from fecocodec.input_file import file_digest, input_digest


@dataclass(frozen=True)
class Result:
    """Output of the work on one scene: its bytes, warnings, and further values for the sidecar."""

    data: bytes
    warnings: tuple[str, ...] = ()
    details: dict[str, Any] = field(default_factory=dict)


@runtime_checkable
class Work(Protocol):
    """What is done to every scene. Instances are pickled; networks are loaded by `run`, once per process.

    suffix: ending of the output files. `options` and `weights` decide the output, together with the input. All raise
    FecoError for scenes or weights that cannot be used.
    """

    @property
    def suffix(self) -> str: ...
    def options(self) -> dict[str, Any]: ...
    def weights(self, path: Path) -> dict[str, str]: ...
    def run(self, path: Path, name: str) -> Result: ...


@dataclass(frozen=True)
class SceneTask:
    """Work on the scenes of one run.

    folder: of the outputs. run_id: unique id of the run. is_forced: redo scenes whose sidecar matches and replace files
    without a sidecar. retries_failed: redo scenes that failed before with the same input and options. phrase: applied
    to each warning and error before it is recorded; pickled with the task.
    """

    work: Work
    folder: Path
    run_id: str
    is_forced: bool = False
    retries_failed: bool = False
    phrase: Callable[[str], str] = str

    def run(self, scene: BatchScene) -> Outcome:
        """Work on one scene. Errors are recorded in its sidecar and in the result, not raised."""
        start = perf_counter()
        attempt = _Attempt(self, scene)
        try:
            attempt.read()
            if attempt.is_settled():
                return attempt.earlier_outcome()
            attempt.require_own_output()
            result = self.work.run(scene.path, scene.name)
            return attempt.finish(result, perf_counter() - start)
        except Exception as error:  # whatever it is, the other scenes go on
            return attempt.fail(error, perf_counter() - start)

    def lost(self, scene: BatchScene, reason: str) -> Outcome:
        """Record the failure of a scene whose process ended before the work on it did. reason: a sentence."""
        attempt = _Attempt(self, scene)
        try:
            attempt.read()
            if attempt.is_settled():  # it ended after the sidecar was written
                return attempt.earlier_outcome()
            raise InputError(f"{scene.path}: {reason}")
        except Exception as error:
            return attempt.fail(error, 0.0)


class _Attempt:
    """One attempt at one scene. earlier: sidecar of an earlier attempt. inputs: None until they could be read."""

    def __init__(self, task: SceneTask, scene: BatchScene) -> None:
        self.task, self.scene = task, scene
        self.output = task.folder / f"{scene.name}{task.work.suffix}"
        self.earlier: Record | None = None
        self.inputs: Inputs | None = None

    def read(self) -> None:
        """Read the sidecar, and what decides the output. Raises FecoError."""
        work, path = self.task.work, self.scene.path
        self.earlier = read_sidecar(self.output)
        self.inputs = as_stored(Inputs(input_digest(path), work.options(), work.weights(path)))

    def is_settled(self) -> bool:
        """Return whether an earlier attempt with the same inputs is final."""
        if self.earlier is None or self.earlier.inputs != self.inputs:
            return False
        is_same_run = self.earlier.run == self.task.run_id
        if self.earlier.status == "failed":
            return is_same_run or not (self.task.retries_failed or self.task.is_forced)
        return (is_same_run or not self.task.is_forced) and self._is_intact(self.earlier)

    def earlier_outcome(self) -> Outcome:
        assert self.earlier is not None
        return outcome_of(self.earlier, is_new=self.earlier.run == self.task.run_id)

    def require_own_output(self) -> None:
        """Raise ForeignFileError if there is an output that no batch has written, unless the task is forced."""
        if self.task.is_forced or not self.output.exists():
            return
        # A finished record precedes its output, so the file may still be the one before.
        if self.earlier is None or (self.earlier.status == "failed" and not self._is_intact(self.earlier)):
            raise ForeignFileError(
                f"{self.output}: this file has no sidecar; choose another output folder or replace it by `overwrite`."
            )

    def finish(self, result: Result, seconds: float) -> Outcome:
        """Write the sidecar, then the output: an output without its sidecar would count as foreign."""
        self.require_own_output()
        sha256 = hashlib.sha256(result.data).hexdigest()
        record = replace(
            self._record("done", seconds),
            num_bytes=len(result.data),
            sha256=sha256,
            details=result.details,
            warnings=tuple(self.task.phrase(sentence) for sentence in result.warnings),
        )
        write_sidecar(self.output, record)
        write_file(self.output, result.data, overwrite=True)
        return outcome_of(record, is_new=True)

    def fail(self, error: Exception, seconds: float) -> Outcome:
        """Record a failure. An earlier output stays and stays known as one of the batch."""
        is_expected = isinstance(error, FecoError)
        sentence = (
            self.task.phrase(str(error)) if is_expected else f"{self.scene.path}: {type(error).__name__}: {error}"
        )
        record = replace(
            self._record("failed", seconds),
            inputs=None if isinstance(error, OutputError) else self.inputs,  # not their fault: the next run tries again
            sha256=None if self.earlier is None else self.earlier.sha256,
            error=sentence,
            traceback=None if is_expected else "".join(format_exception(error)),
        )
        if not isinstance(error, ForeignFileError):
            try:
                write_sidecar(self.output, record)
            except OutputError as second:
                record = replace(record, error=f"{sentence} It is not recorded: {second}")
        return outcome_of(record, is_new=True)

    def _record(self, status: Status, seconds: float) -> Record:
        return Record(
            scene=self.scene.name,
            source=str(self.scene.path),
            status=status,
            inputs=self.inputs,
            output=self.output.name,
            num_bytes=None,
            sha256=None,
            seconds=round(seconds, 3),
            finished=datetime.now(UTC).isoformat(timespec="seconds"),
            run=self.task.run_id,
            version=__version__,
        )

    def _is_intact(self, record: Record) -> bool:
        try:
            return file_digest(self.output) == record.sha256
        except OSError:
            return False
