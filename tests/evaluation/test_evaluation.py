"""An evaluation from scenes on disk to tables: resumed, and not lost to one broken scene.

Bjontegaard differences of curves whose difference is known.
"""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.errors import InputError
from fecocodec.evaluation import evaluation, run
from fecocodec.evaluation.evaluation import RECORDS, Plan, choose_entries, evaluate_to_folder
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.records import Measurement, RecordFile
from fecocodec.evaluation.summary import as_tsv, averages, compare
from fecocodec.sender.optimisation_config import EFFORTS, FAST
from tests.chunk_files import write_wall_chunks
from tests.example_scenes import MODEL

INDEX = {"wall0": {"context": [0, 2], "target": [1]}, "gone": {"context": [0, 2], "target": [1]}}


@pytest.fixture
def plan(tmp_path: Path, random_weights: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Without steps of optimisation, and without charts, which `test_paper_tables` draws."""
    monkeypatch.setitem(EFFORTS, "default", FAST)
    monkeypatch.setattr(evaluation, "write_png", lambda _chart, path: path.write_bytes(b""))
    root = write_wall_chunks(tmp_path / "chunks", num_scenes=1)
    index = tmp_path / "evaluation.json"
    index.write_text(json.dumps(INDEX))
    size = (64, 96)
    return Plan(root, index, random_weights / MODEL, tmp_path / "out", ("codec", "trivial"), (1e-2,), size)


def test_one_broken_scene_loses_nothing_else_and_a_second_run_measures_nothing_again(plan: Plan) -> None:
    report = evaluate_to_folder(plan)
    assert [failure.entry for failure in report.failures] == ["gone"] * 3
    assert "has no scene gone" in report.failures[0].error
    systems = ("fecosplat", "nearest view", "best plane")
    assert [(row.system, row.entries) for row in report.averages] == [(system, 1) for system in systems]
    for row in report.averages:
        assert all(value is not None and 0 < value < 1 for value in (row.st_lpips, row.lpips, row.lpips_alex))
    assert sorted(path.name for path in (plan.output / "strips").iterdir()) == ["wall0.png"]
    assert (plan.output / "curves_psnr.png").exists()
    lines = (plan.output / RECORDS).read_text().splitlines()
    plan.index.write_text(json.dumps({"wall0": INDEX["wall0"]}))
    again = evaluate_to_folder(plan)
    assert (plan.output / RECORDS).read_text().splitlines() == lines
    assert again.averages == report.averages and again.failures == ()
    summary = json.loads((plan.output / "summary.json").read_text())
    assert summary["averages"][0]["kib"] == report.averages[0].kib
    assert {"processor", "torch", "date"} <= summary["machine"].keys()


def test_other_frames_or_photographs_are_measured_again(plan: Plan) -> None:
    plan = replace(plan, groups=("trivial",), with_strips=False)
    write_wall_chunks(plan.root, num_scenes=1, num_frames=4)

    def rows(target: int) -> list[dict]:
        plan.index.write_text(json.dumps({"wall0": {"context": [0, 2], "target": [target]}}))
        evaluate_to_folder(plan)
        return [json.loads(line) for line in (plan.output / RECORDS).read_text().splitlines()]

    first = rows(1)
    old = [{name: value for name, value in row.items() if name != "inputs"} for row in first]
    (plan.output / RECORDS).write_text("".join(json.dumps(row) + "\n" for row in old))  # of an earlier version
    assert rows(1) == rows(1) and [row["inputs"] for row in rows(1)[2:]] == [row["inputs"] for row in first]
    assert len(rows(3)) == 6 and len(rows(1)) == 6
    write_wall_chunks(plan.root, num_scenes=1, num_frames=4, fx=90.0)
    assert len(rows(1)) == 8


def test_the_files_of_a_scene_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "scene" / "images").mkdir(parents=True)
    entry, cameras = IndexEntry("scene/a", "scene", (0, 1), (2,)), tmp_path / "scene" / "transforms.json"
    read, found = open_scenes(tmp_path), set()
    for text in ("[1]", "[2]", "[1]"):
        cameras.write_text(text)
        found.add(read.digest(entry))
    (tmp_path / "scene" / "images" / "0.png").write_bytes(b"0")
    found |= {read.digest(entry), read.digest(replace(entry, guide=(3,)))}
    assert len(found) == 4


def test_guided_systems_are_measured_on_entries_with_guides_alone(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"evaluation\.json: no entry has `guide`, the frames that teach"):
        evaluate_to_folder(replace(plan, groups=("guided",)))
    monkeypatch.setattr(run, "check_input", lambda views: ("is dark.",) if "0:0" in views.names else ())
    write_wall_chunks(plan.root, num_scenes=2, num_frames=4)
    without = {"context": [0, 2], "target": [1]}
    plan.index.write_text(json.dumps({"wall0": without, "wall1": {"context": [1, 2], "target": [0], "guide": [3]}}))
    fractions = []
    plan = replace(plan, groups=("guided", "trivial"), with_strips=False)
    report = evaluate_to_folder(plan, lambda _found, fraction: fractions.append(fraction))
    systems = ("fecosplat, guided", "nearest view", "best plane")
    assert {(row.system, row.entries) for row in report.averages} == {(system, 1) for system in systems}
    assert report.doubtful == ("wall0",)
    known = RecordFile(plan.output / RECORDS).measurements.values()
    assert [m.warnings for m in known if m.entry == "wall0"] == ["is dark."] * 2
    assert fractions == [n / 5 for n in range(1, 6)]


def measurement(entry: str, system: str, setting: str, num_bytes: int, psnr: float) -> Measurement:
    return Measurement(entry, system, setting, "model", num_bytes=num_bytes, psnr=psnr)


def test_averages_are_over_common_entries_and_curves_are_compared() -> None:
    found = [
        measurement(entry, system, f"{step}", factor * 1024 * 2**step, 20.0 + step)
        for entry in ("a", "b")
        for system, factor in (("fecosplat", 1), ("AVIF", 2))
        for step in range(4)
    ]
    failed = replace(found[0], entry="c", error="broken")
    only_one = measurement("c", "AVIF", "0", 9, 50.0)
    rows = averages([*found, failed, only_one])
    assert {row.entries for row in rows} == {2}
    (comparison,) = compare(rows)
    assert comparison.baseline == "AVIF" and comparison.bd_rate == pytest.approx(-50.0)
    header, *lines = as_tsv(rows).splitlines()
    assert header.split("\t")[:4] == ["system", "setting", "entries", "kib"] and len(lines) == 8


def test_curves_are_compared_at_what_they_share() -> None:
    psnr = (20.0, 22.5, 23.0, 23.1, 24.0)
    found = [
        measurement("a", system, f"lambda {step}", 1024 * 2**step, psnr[step])
        for system, steps in (("fecosplat", range(5)), ("stage 1 alone", (0, 2, 4)))
        for step in steps
    ]
    (comparison,) = compare(averages(found))
    assert comparison.bd_rate == pytest.approx(0.0, abs=1e-9) and comparison.bd_psnr == pytest.approx(0.0, abs=1e-9)
    # Ours needs half the bytes at equal PSNR, but twice the bytes at equal ST-LPIPS.
    found = [
        replace(measurement("a", system, f"{step}", factor * 1024 * 2**step, 20.0 + step), st_lpips=worst - 0.1 * step)
        for system, factor, worst in (("fecosplat", 1, 0.6), ("AVIF", 2, 0.4))
        for step in range(4)
    ]
    (comparison,) = compare(averages(found))
    assert comparison.bd_rate == pytest.approx(-50.0) and comparison.bd_rate_st_lpips == pytest.approx(100.0)
    unknown = [replace(m, st_lpips=None) if m.system == "AVIF" else m for m in found]
    (comparison,) = compare(averages(unknown))
    assert comparison.bd_rate == pytest.approx(-50.0) and comparison.bd_rate_st_lpips is None


def test_other_files_are_no_measurements(tmp_path: Path) -> None:
    path = tmp_path / RECORDS
    records = RecordFile(path)
    for entry in ("a", "b"):
        records.add(measurement(entry, "fecosplat", "x", 10, 20.0))
    path.write_text(path.read_text()[:-30])
    known = RecordFile(path)
    assert known.is_known(("a", "fecosplat", "x", "model", ""))
    assert not known.is_known(("b", "fecosplat", "x", "model", ""))
    known.add(measurement("b", "fecosplat", "x", 10, 20.0))
    assert RecordFile(path).is_known(("b", "fecosplat", "x", "model", ""))
    path.write_text('{"what": 1}\n{"else": 2}\n')
    with pytest.raises(InputError, match=r"measurements\.jsonl: not measurements of this version .*another output"):
        RecordFile(path)


def test_entries_are_thinned_evenly() -> None:
    entries = [IndexEntry(f"{n}", f"{n}", (0, 1) if n < 9 else (0, 1, 2), (2,)) for n in range(12)]
    assert [e.name for e in choose_entries(entries, 2, 3, Path("i.json"))] == ["0", "4", "8"]
    assert [e.name for e in choose_entries(entries, 3, None, Path("i.json"))] == ["9", "10", "11"]
    with pytest.raises(InputError, match="has no entry with 5 context views"):
        choose_entries(entries, 5, None, Path("i.json"))
