"""Run the measurements of a report. Each result is written at once, so that an interrupted report is resumed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fecocodec.atomic import make_folder
from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.evaluation.evaluation import RECORDS, choose_entries, weights_label
from fecocodec.evaluation.machine import StepClock
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.records import Measurement, RecordFile, append_row, read_rows
from fecocodec.evaluation.report.complexity_section import Need, measure_need, photograph_kib
from fecocodec.evaluation.report.scaling_section import LAMBDA, Load, measure_load
from fecocodec.evaluation.report.section import ReportPlan
from fecocodec.evaluation.run import measure_all
from fecocodec.evaluation.stress.box_room import Room, painted, photograph, sideways
from fecocodec.evaluation.stress.suite import STRESS_LAMBDA, Verdict, read_pairs, run_suite
from fecocodec.evaluation.systems.codec import speed_systems
from fecocodec.evaluation.systems.groups import systems_of
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with


class ResultFile:
    """Results by key, for one set of weights. Results of other weights in the file are ignored."""

    def __init__(self, path: Path, label: str) -> None:
        """label: identifies the weights. Raises InputError if the file does not contain results."""
        self._path, self._label = path, label
        self._known: dict[str, dict[str, Any]] = {}
        try:
            rows = read_rows(path) if path.exists() else []
            self._known = {row["key"]: row["values"] for row in rows if row["label"] == label}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not results of this version ({error}); give another work folder.") from error

    def known(self) -> Mapping[str, dict[str, Any]]:
        """Return all results in the order of measurement."""
        return self._known

    def add(self, key: str, values: dict[str, Any]) -> None:
        """Store a result and append it to the file. Raises OutputError if writing fails."""
        self._known[key] = values
        append_row(self._path, {"key": key, "label": self._label, "values": values})

    def measured(self, key: str, measure: Callable[..., Any], *arguments: Any) -> dict[str, Any]:
        """Return the result of a key. If it is not known, it is measured, as a dataclass, and stored."""
        if key not in self._known:
            self.add(key, asdict(measure(*arguments)))
        return self._known[key]


OnStudy = Callable[[str], None]  # name of the next study
WARM_UP_SIDE = 64
WARM_RUNS = 3


@dataclass(frozen=True)
class Studies:
    """All measurements of a report.

    rate: two-view entries with all systems. speed: the same entries at further operating points. photographs: more
    two-view entries, at one lambda. complexity: size of the context views in KiB, by entry of `photographs`.
    more_views: entries with more than two context views. steps: seconds by step, for "encode" and "decode". loads:
    scaling study. needs: synthetic rooms. verdicts: stress cases.
    """

    rate: tuple[Measurement, ...]
    speed: tuple[Measurement, ...]
    photographs: tuple[Measurement, ...]
    complexity: dict[str, float]
    more_views: tuple[Measurement, ...]
    steps: dict[str, dict[str, float]]
    loads: tuple[Load, ...]
    needs: tuple[Need, ...]
    verdicts: tuple[Verdict, ...]


def measure_studies(plan: ReportPlan, on_study: OnStudy) -> Studies:
    """Run all measurements that `plan.work` does not contain yet. Raises FecoError if nothing can be measured."""
    open_scenes(plan.root)
    read_index(plan.index)  # both raise for wrong paths before anything is measured
    codec = load_codec(plan.model, "cpu")
    make_folder(plan.work)
    label = weights_label(plan.model, plan.size)
    on_study("warming up")
    _code(codec, _room(WARM_UP_SIDE))
    on_study("growth with views and pixels")
    loads = _loads(plan, codec, ResultFile(plan.work / "scaling.jsonl", label))
    on_study("time by step")
    steps = _steps(plan, codec, ResultFile(plan.work / "steps.jsonl", label))
    on_study("rooms from bare to crowded")
    needs = _needs(plan, codec, ResultFile(plan.work / "complexity.jsonl", label))
    rate, speed, photographs, more_views = _measurements(plan, codec, label, on_study)
    complexity = _complexity(plan, {measurement.entry for measurement in photographs if not measurement.error})
    on_study("stress cases")
    verdicts = _verdicts(plan, codec, ResultFile(plan.work / "stress_cases.jsonl", label))
    return Studies(rate, speed, photographs, complexity, more_views, steps, loads, needs, verdicts)


def _measurements(plan: ReportPlan, codec: Codec, label: str, on_study: OnStudy) -> tuple[tuple[Measurement, ...], ...]:
    """Run the studies of rate, speed, complexity and more views. They share one file to avoid repeated measurements."""
    index = read_index(plan.index)
    pairs = choose_entries(index, 2, plan.entries, plan.index)
    more = [entry for entry in index if len(entry.context) > 2]
    records = RecordFile(plan.work / RECORDS)
    read = open_scenes(plan.root, plan.size)

    def measured(entries: Sequence[IndexEntry], systems: Sequence[System]) -> tuple[Measurement, ...]:
        return tuple(measure_all(read, entries, systems, records, label))

    on_study("rate and quality")
    rate_systems = systems_of(["codec"], codec, plan.lambdas)
    rate_systems += systems_of(["fast", "best", "ablations"], codec, plan.few_lambdas)
    rate = measured(pairs, rate_systems + systems_of(["images", "gaussians", "trivial"], codec, ()))
    on_study("speed and quality")
    speed = measured(pairs, [system for lmbda in plan.few_lambdas for system in speed_systems(codec, lmbda)])
    on_study("bytes and complexity")
    many = choose_entries(index, 2, plan.complexity_entries, plan.index)
    photographs = measured(many, systems_of(["codec"], codec, [LAMBDA]))
    on_study("more views")
    thinned = choose_entries(more, None, plan.entries_of_more_views, plan.index) if more else ()
    return rate, speed, photographs, measured(thinned, systems_of(["codec"], codec, [LAMBDA]))


def _complexity(plan: ReportPlan, entries: set[str]) -> dict[str, float]:
    """Return the size of the context views in KiB, by entry name."""
    read = open_scenes(plan.root, plan.size)
    found = [entry for entry in read_index(plan.index) if entry.name in entries]
    return {entry.name: photograph_kib(read(entry).select(list(range(len(entry.context))))) for entry in found}


def _loads(plan: ReportPlan, codec: Codec, results: ResultFile) -> tuple[Load, ...]:
    shapes = [(2, side) for side in plan.sides] + [(count, plan.room_side) for count in plan.view_counts]
    keys = {f"{count} views of {side}": (count, side) for count, side in shapes}
    return tuple(Load(**results.measured(key, measure_load, codec, *shape)) for key, shape in keys.items())


def _needs(plan: ReportPlan, codec: Codec, results: ResultFile) -> tuple[Need, ...]:
    keys = {f"{count} patterns on {plan.room_side}": count for count in plan.num_waves}
    return tuple(Need(**results.measured(key, measure_need, codec, n, plan.room_side)) for key, n in keys.items())


def _steps(plan: ReportPlan, codec: Codec, results: ResultFile) -> dict[str, dict[str, float]]:
    """Return the seconds by step of both ends, from the last of WARM_RUNS runs."""
    key = f"two views of {plan.room_side}"
    if key not in results.known():
        runs = [_code(codec, _room(plan.room_side)) for _ in range(WARM_RUNS)]
        results.add(key, runs[-1])
    return dict(results.known()[key])


def _room(side: int) -> Views:
    return photograph(Room(painted), sideways()[:2], (side, side))


def _code(codec: Codec, views: Views) -> dict[str, dict[str, float]]:
    """Encode and decode; return the seconds by step of both ends."""
    encoding = StepClock()
    data = encode_with(codec, views, quantise_lambda(LAMBDA), on_progress=encoding)
    encoding.close()
    decoding = StepClock()
    decode_with(codec.receiver, data, on_progress=decoding)
    decoding.close()
    return {"encode": encoding.seconds, "decode": decoding.seconds}


def _verdicts(plan: ReportPlan, codec: Codec, results: ResultFile) -> tuple[Verdict, ...]:
    if plan.stress_scenes == 0:
        return ()
    pairs = read_pairs(plan.root, plan.index, plan.stress_scenes)
    known = {key: Verdict(**values) for key, values in results.known().items()}
    verdicts = []
    for verdict, _ in run_suite(codec, pairs, STRESS_LAMBDA, known):
        if verdict.case not in known:
            results.add(verdict.case, asdict(verdict))
        verdicts.append(verdict)
    return tuple(verdicts)
