"""Run a batch: hand its scenes to an engine, and return how each of them ended."""

import secrets
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol, runtime_checkable

from fecocodec.atomic import make_folder, write_file
from fecocodec.batch.scene_task import SceneTask, Work
from fecocodec.batch.scenes import BatchScene
from fecocodec.batch.sidecar import Outcome, as_tsv
from fecocodec.errors import InputError, installation
from fecocodec.input_file import StrPath


@runtime_checkable
class Engine(Protocol):
    """Runs a task on every scene, in any order; each scene gives one outcome, also if the process of a task ends."""

    def outcomes(self, task: SceneTask, scenes: Sequence[BatchScene]) -> Iterator[Outcome]: ...


class ThisProcess:
    """Engine that works on one scene after another in this process."""

    def outcomes(self, task: SceneTask, scenes: Sequence[BatchScene]) -> Iterator[Outcome]:
        """Yield one outcome per scene, in their order."""
        yield from map(task.run, scenes)


def run_batch(
    scenes: Sequence[BatchScene],
    output: StrPath,
    work: Work,
    engine: Engine | None = None,
    *,
    overwrite: bool = False,
    retry_failed: bool = False,
    phrase: Callable[[str], str] = str,
) -> Iterator[Outcome]:
    """Yield the outcome of each scene as it ends. The outputs are `output/NAME.SUFFIX`, each with a sidecar.

    Scenes whose sidecar and output match are skipped, failures are yielded and do not stop the rest. engine: None for
    this process. overwrite: redo all scenes, and replace files without a sidecar. retry_failed: redo scenes that failed
    before with the same input and options. phrase: applied to each warning and error before it is recorded, for example
    to name options instead of arguments; it is pickled.

    Raises OutputError if the folder cannot be created, before any work.
    """
    folder = Path(output).absolute()
    make_folder(folder)
    task = SceneTask(work, folder, secrets.token_hex(8), overwrite, retry_failed, phrase)
    return (engine or ThisProcess()).outcomes(task, scenes)


def write_summary(path: StrPath, scenes: Sequence[BatchScene], outcomes: Iterable[Outcome]) -> None:
    """Write a table of the outcomes, in the order of the scenes; it replaces an earlier one. Raises OutputError."""
    of_scene = {outcome.scene: outcome for outcome in outcomes}
    ordered = [of_scene[scene.name] for scene in scenes if scene.name in of_scene]
    write_file(Path(path), as_tsv(ordered), overwrite=True)


def has_cluster_extra() -> bool:
    """Return whether Dask distributed is installed."""
    return find_spec("distributed") is not None


def require_cluster_extra() -> None:
    """Raise InputError, which names the extra to install, if Dask distributed is missing."""
    if not has_cluster_extra():
        raise InputError(
            f"several processes need the package distributed; run {installation('cluster')}, or use one process by "
            "`workers=1`."
        )
