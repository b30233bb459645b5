"""Throughput, scheduler's share and memory of `fecosplat batch encode` with 1 and 2 workers on this machine.

    python benchmarks/bench_batch.py ROOT [--scenes 12] [--size 256] [--effort fast]

ROOT holds scene folders. Each scene is encoded from two views (`Spread(2)`) with one thread per worker. Networks are
loaded before the clock starts. One line per number of workers is printed: scenes a minute; time and CPU time of the
workers per scene; share of the workers' time outside the work on scenes; CPU time of this process, which runs client
and scheduler, per scene; peak memory of the largest worker and of this process; time per scene of a second run, which
skips all; and bytes of files and sidecars. The last lines compare the numbers of workers.
"""

import argparse
import resource
import sys
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

from fecocodec.batch.cluster import local_cluster
from fecocodec.batch.encode_scene import EncodeScene
from fecocodec.batch.run import run_batch
from fecocodec.batch.scene_task import Result
from fecocodec.batch.scenes import BatchScene, scene_folders
from fecocodec.batch.sidecar import Outcome
from fecocodec.captures.view_selection import Spread
from fecocodec.codec.options import EncodingOptions

HEAD = (
    "workers",
    "start s",
    "scenes/min",
    "s/scene",
    "CPU s/scene",
    "idle share",
    "scheduler ms/scene",
    "worker GiB",
    "this GiB",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--effort", default="fast")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--empty", type=int, metavar="N", help="only measure N scenes without work, on 2 workers")
    arguments = parser.parse_args()
    if arguments.empty:
        print("\t".join(measure_empty(arguments.empty)))
        return
    scenes = scene_folders(arguments.root)[: arguments.scenes]
    work = EncodeScene(EncodingOptions(views=Spread(2), size=(arguments.size, arguments.size), effort=arguments.effort))
    print("\t".join((*HEAD, "skip ms/scene", "bytes/scene", "sidecar bytes")))
    rates = []
    for num_workers in arguments.workers:
        cells = measure(scenes, work, num_workers)
        print("\t".join(cells), flush=True)
        rates.append(float(cells[HEAD.index("scenes/min")]))
    for num_workers, rate in zip(arguments.workers[1:], rates[1:], strict=True):
        ratio = rate / rates[0]
        print(f"{num_workers} workers encode {ratio:.2f} times as many scenes a minute as {arguments.workers[0]}")


def measure(scenes: tuple[BatchScene, ...], work: EncodeScene, num_workers: int) -> tuple[str, ...]:
    """Return the cells of one line."""
    start = perf_counter()
    with TemporaryDirectory() as folder, local_cluster(num_workers) as engine:
        warm_up = [BatchScene(f"warm_up_{number}", scenes[0].path) for number in range(num_workers)]
        require_done(run_batch(warm_up, Path(folder, "warm"), work, engine))
        of_workers = sum(engine.client.run(process_time).values())
        begin, cpu = perf_counter(), process_time()
        outcomes = require_done(run_batch(scenes, Path(folder, "out"), work, engine))
        end, cpu = perf_counter(), process_time() - cpu
        of_workers = sum(engine.client.run(process_time).values()) - of_workers
        require_done(run_batch(scenes, Path(folder, "out"), work, engine))
        skipping = perf_counter() - end
        peak = max(engine.client.run(peak_gib).values())
        sidecars = [path.stat().st_size for path in Path(folder, "out").glob("*.json")]
    seconds, count = end - begin, len(scenes)
    busy = sum(outcome.seconds for outcome in outcomes)
    return (
        f"{num_workers}", f"{begin - start:.1f}", f"{60 * count / seconds:.1f}", f"{busy / count:.2f}",
        f"{of_workers / count:.2f}",
        f"{100 * (1 - busy / (num_workers * seconds)):.1f}%", f"{1000 * cpu / count:.1f}", f"{peak:.2f}",
        f"{peak_gib():.2f}", f"{1000 * skipping / count:.1f}",
        f"{sum(outcome.num_bytes or 0 for outcome in outcomes) / count:.0f}", f"{sum(sidecars) / count:.0f}",
    )  # fmt: skip


class Empty:
    """No work: what remains is the cost of Dask, of the digest of a small file, and of writing two small files."""

    suffix = ".empty"

    def options(self) -> dict:
        return {}

    def weights(self, path: Path) -> dict[str, str]:
        return {}

    def run(self, path: Path, name: str) -> Result:
        return Result(b"")


def measure_empty(count: int) -> tuple[str, ...]:
    """Return the time per scene, and the CPU time of this process per scene, for scenes without work."""
    with TemporaryDirectory() as folder, local_cluster(2) as engine:
        source = Path(folder, "source")
        source.write_text("content")
        scenes = [BatchScene(f"{number:06d}", source) for number in range(count)]
        require_done(run_batch(scenes[:10], Path(folder, "warm"), Empty(), engine))
        begin, cpu = perf_counter(), process_time()
        require_done(run_batch(scenes, Path(folder, "out"), Empty(), engine))
        seconds, cpu = perf_counter() - begin, process_time() - cpu
    return f"{1000 * seconds / count:.2f} ms/scene", f"{1000 * cpu / count:.2f} ms/scene of CPU, client and scheduler"


def require_done(outcomes: Iterable[Outcome]) -> list[Outcome]:
    found = list(outcomes)
    if failed := [of for of in found if of.status == "failed"]:
        sys.exit(f"{failed[0].scene}: {failed[0].error}")
    return found


def peak_gib() -> float:
    """Return the peak resident memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


if __name__ == "__main__":
    main()
