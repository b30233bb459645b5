"""Engine on Dask workers: processes of this machine, or those of a running scheduler.

Only this file imports Dask, the `cluster` extra; `require_cluster_extra` of `run` reports if it is missing.
"""

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from time import monotonic
from typing import Any

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed

from fecocodec import __version__
from fecocodec.batch.scene_task import SceneTask
from fecocodec.batch.scenes import BatchScene
from fecocodec.batch.sidecar import Outcome
from fecocodec.errors import InputError

SECONDS_TO_ANSWER = 10
SECONDS_FOR_A_WORKER = 60
SCENES_PER_THREAD = 3  # submitted at a time: one in work, the others on their way; more would fill the scheduler
_SECONDS_BETWEEN_COUNTS = 10.0
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Cluster:
    """Engine on the workers of a Dask client."""

    client: Client

    def outcomes(self, task: SceneTask, scenes: Sequence[BatchScene]) -> Iterator[Outcome]:
        """Yield outcomes as they end; scenes of a lost worker go to another. Raises InputError for a lost scheduler."""
        waiting, in_work = iter(scenes), dict[object, BatchScene]()
        running = as_completed()
        window = _Window(self.client)
        while True:
            for scene in islice(waiting, max(0, window.size() - len(in_work))):
                future = self.client.submit(task.run, scene, pure=False)
                in_work[future.key] = scene
                running.add(future)
            if not in_work:
                return
            future = next(running)
            yield _outcome(task, in_work.pop(future.key), future)


class _Window:
    """Number of scenes to hand to the scheduler at a time; it follows the workers that come and go."""

    def __init__(self, client: Client) -> None:
        self._client, self._size, self._until = client, 0, 0.0

    def size(self) -> int:
        if monotonic() >= self._until:
            num_threads = sum(self._client.nthreads().values())
            self._size, self._until = max(1, SCENES_PER_THREAD * num_threads), monotonic() + _SECONDS_BETWEEN_COUNTS
        return self._size


def _outcome(task: SceneTask, scene: BatchScene, future: "Future[Any]") -> Outcome:
    """Return the outcome of a finished future. Raises InputError if the scheduler is lost."""
    try:
        outcome: Outcome = future.result()
        return outcome
    except KilledWorker:
        return task.lost(
            scene, "the processes that worked on it were killed; check the memory, or give fewer or smaller views."
        )
    except CancelledError as error:
        raise InputError(
            "the connection to the scheduler was lost; run the same command again, it skips what is done."
        ) from error
    except Exception as error:  # raised before or after the task itself, such as by another version of Dask
        return task.lost(scene, f"the worker could not run it ({type(error).__name__}: {error}); check its log.")


@contextmanager
def local_cluster(num_workers: int, num_threads: int = 1) -> Iterator[Cluster]:
    """Yield an engine on new processes of this machine, which end with the block.

    num_threads: of the numeric libraries in each process; each works on one scene at a time.
    """
    # One scene at a time is sent to a process, so that only this scene is blamed if the process is killed.
    one_scene = dask.config.set({"distributed.scheduler.worker-saturation": 1.0})
    variables = dict.fromkeys(_THREAD_VARIABLES, str(num_threads))
    with (
        one_scene,
        LocalCluster(
            n_workers=num_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            memory_limit=0,  # the operating system decides; Dask would kill a process at 95% of its share
            silence_logs=logging.CRITICAL,
            env=variables,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield Cluster(client)
        with suppress(TimeoutError):  # Dask fails to close while it replaces a process that was killed
            client.wait_for_workers(num_workers, timeout=SECONDS_FOR_A_WORKER)


@contextmanager
def connected_cluster(address: str) -> Iterator[Cluster]:
    """Yield an engine on the workers of a running scheduler, which goes on after the block.

    address: such as "tcp://host:8786". Raises InputError if the scheduler does not answer within SECONDS_TO_ANSWER, has
    no worker for SECONDS_FOR_A_WORKER, or a worker has another version.
    """
    try:
        client = Client(address, timeout=SECONDS_TO_ANSWER)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"scheduler {address}: it does not answer within {SECONDS_TO_ANSWER} s; start `dask scheduler`, or correct "
            "the address."
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=SECONDS_FOR_A_WORKER)
        except TimeoutError as error:
            raise InputError(
                f"scheduler {address}: it has no workers; start `dask worker {address}` on the machines."
            ) from error
        _require_same_version(client, address)
        yield Cluster(client)


def _require_same_version(client: Client, address: str) -> None:
    """Raise InputError if a worker does not have this version of the library."""
    try:
        versions = client.run(_version)
    except Exception as error:  # raised on the worker, whatever it lacks
        raise InputError(
            f"scheduler {address}: a worker cannot load fecosplat ({error}); install it for all workers."
        ) from error
    for worker, version in versions.items():
        if version != __version__:
            raise InputError(
                f"worker {worker}: it has fecosplat {version}, but this is {__version__}; install the same version."
            )


def _version() -> str:
    return __version__
