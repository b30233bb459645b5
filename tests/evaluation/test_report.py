"""The report from made-up measurements: what it says follows from them, and its files stand alone.

The seconds between messages of progress belong to the message that began them.
"""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from fecocodec.errors import InputError
from fecocodec.evaluation import machine
from fecocodec.evaluation.machine import StepClock, forget_peak, peak_mib
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report import make
from fecocodec.evaluation.report.complexity_section import Need
from fecocodec.evaluation.report.make import html_page
from fecocodec.evaluation.report.rate_section import rate_sections
from fecocodec.evaluation.report.scaling_section import Load, exponent, scaling_section
from fecocodec.evaluation.report.section import Chart, Mark, ReportPlan, Series, pareto_front, table, write_panels
from fecocodec.evaluation.report.speed_section import speed_section
from fecocodec.evaluation.report.studies import ResultFile, Studies
from fecocodec.evaluation.stress.suite import Verdict

ENTRIES = ("a", "b", "c")
SETTINGS = ("lambda 0.01", "lambda 0.001", "lambda 0.0001")


def curve(system: str, kib: float, psnr: float, seconds: float = 1.0) -> list[Measurement]:
    """Three points that double in bytes and gain 1 dB each, of three entries that double in bytes."""
    one = Measurement("", system, "", "weights", num_context=2, height=64, width=64, num_gaussians=1000)
    one = replace(one, encode_seconds=seconds, decode_seconds=seconds / 10)
    return [
        replace(one, entry=entry, setting=setting, num_bytes=int(kib * 1024 * 2**step * 2**at), psnr=psnr + step)
        for at, entry in enumerate(ENTRIES)
        for step, setting in enumerate(SETTINGS)
    ]


@pytest.fixture
def studies() -> Studies:
    rate = [*curve("fecosplat", 2.0, 20.0), *curve("stage 1 alone", 1.5, 19.0)]
    rate += [replace(m, setting=m.setting.replace("lambda", "quality")) for m in curve("JPEG XL", 4.0, 20.0)]
    rate += [replace(m, setting="copied", num_bytes=0) for m in curve("nearest view", 1.0, 15.0)[:: len(SETTINGS)]]
    rate = [replace(m, st_lpips=0.5 - 0.01 * m.psnr) for m in rate]
    speed = [
        *curve("fecosplat", 2.0, 20.0),
        *curve("fecosplat, effort fast", 2.0, 19.0, 0.05),
        *curve("one thread", 2.0, 20.0, 2.0),
    ]
    steps = {"encode": {"start": 0.01, "coding stage 1": 0.03}, "decode": {"predicting": 0.02}}
    loads = tuple(Load(2, side, 2 * side**2, side**2 / 1e5, side / 1e4, 100.0, side**2) for side in (64, 128))
    needs = (Need(0, 1.0, 1.0, 0.1), Need(24, 9.0, 8.0, 0.2))
    verdicts = (Verdict("wall: reference", "≤0", 20.0, 0.0, 3.5, 0.4, 3.4, 0, "a Gaussian is not finite"),)
    pairs = [m for m in rate if m.system == "fecosplat"]
    complexity = {entry: 4.0 * 2**at for at, entry in enumerate(ENTRIES)}
    return Studies(tuple(rate), tuple(speed), tuple(pairs), complexity, (), steps, loads, needs, verdicts)


@pytest.fixture
def plan(studies: Studies, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ReportPlan:
    """A report whose measurements are the studies."""
    monkeypatch.setattr(make, "measure_studies", lambda _plan, _on_study: studies)
    monkeypatch.setattr(make, "weights_label", lambda _model, _size: "0123")
    return ReportPlan(tmp_path, tmp_path, tmp_path / "compact", tmp_path / "work", tmp_path / "docs")


def test_the_files_of_a_report(studies: Studies, plan: ReportPlan) -> None:
    assert make.make_report(plan, lambda _study: None) == ()
    text = (plan.output / "report.md").read_text()
    assert text.startswith(make.TITLE + make.MARK)
    pictures = set(re.findall(r"\]\((report/\w+\.png)\)", text))
    assert pictures == {f"report/{path.name}" for path in (plan.output / "report").glob("*.png")}
    assert len(pictures) == 9 and sum((plan.output / path).stat().st_size for path in pictures) < 1_500_000
    assert "Weights `compact` (0123)" in text and "torch" in text and "0 of 1 cases satisfy their rule" in text
    assert "`wall`:" in text and "| reference | ≤0, **broken** by wall | 20.00 |" in text
    assert text.count("| against | fecosplat at 4 KiB |") == 2
    page = (plan.output / "report" / "charts.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "") and "https://" not in page
    charts = json.loads(re.search(r"const CHARTS = (\[.*\]);\n", page)[1])  # type: ignore[index]
    assert {f"report/{chart['name']}.png" for chart in charts} == pictures


def test_what_stands_above_the_mark_is_kept_and_failures_are_told(
    studies: Studies, plan: ReportPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = replace(studies.rate[0], entry="d", error="is gone")
    monkeypatch.setattr(make, "measure_studies", lambda *_: replace(studies, rate=(*studies.rate, broken)))
    monkeypatch.setattr(make, "write_png", lambda *_: None)
    plan.output.mkdir()
    (plan.output / "report.md").write_text(f"# Ours\n\n{make.MARK}old figures\n")
    assert make.make_report(plan, lambda _study: None) == ("d, fecosplat, lambda 0.01: is gone",)
    text = (plan.output / "report.md").read_text()
    assert text.startswith(f"# Ours\n\n{make.MARK}") and "old figures" not in text and text.count(make.MARK) == 1


def test_lpips_has_a_column_or_a_sentence_that_says_why_not(studies: Studies) -> None:
    without = rate_sections(studies.rate, ())[0].text
    assert "| ST-LPIPS | LPIPS | LPIPS (AlexNet) |" in without
    assert "LPIPS (VGG16) was not measured: its weights are in a clone of the repository only" in without
    measured = rate_sections([replace(m, lpips=0.25, lpips_alex=0.125) for m in studies.rate], ())[0].text
    assert "| 0.250 | 0.125 |" in measured and "was not measured" not in measured


def test_the_front_holds_what_no_other_beats(studies: Studies) -> None:
    marks = [Mark(1.0, 5.0, ""), Mark(2.0, 4.0, "slower and worse"), Mark(3.0, 7.0, ""), Mark(3.0, 6.0, "worse")]
    assert pareto_front(marks) == (marks[0], marks[2])
    sender = speed_section(studies.rate, studies.speed, studies.steps, 64).charts[0]
    names = {series.name for series in sender.series for mark in series.marks if mark in sender.front}
    assert "fecosplat, effort fast" in names and "one thread" not in names


def test_tables_of_growth_and_times(studies: Studies) -> None:
    speed = [replace(m, encode_seconds=float(ENTRIES.index(m.entry))) for m in studies.speed]
    text = speed_section(studies.rate, speed, studies.steps, 64).text
    assert re.search(r"\| one thread \| [\d.]+ \| [\d.]+ \| 1\.000 \(0\.500 to 1\.500\) \|", text)
    steps = {"encode": {"start": 0.001, "matching views": 0.749, "coding stage 1": 0.25}}
    text = speed_section(studies.rate, studies.speed, steps, 64).text
    assert "| encode | 1000 | matching views: 749 (75%); coding stage 1: 250 (25%) |" in text
    huge = [replace(m, system="PLY", num_bytes=1000 * m.num_bytes) for m in studies.rate]
    charts = speed_section([*studies.rate, *huge], studies.speed, studies.steps, 64).charts
    named = [{series.name for series in chart.series} for chart in charts]
    assert "PLY" not in named[0] | named[1] and "PLY" in named[2] & named[3]
    assert exponent([1.0, 2.0, 4.0], [3.0, 12.0, 48.0]) == pytest.approx(2.0)
    assert exponent([2.0], [1.0]) is None
    assert "| two views of more pixels | 1.00 | 0.50 | 0.00 | 1.00 |" in scaling_section(studies.loads, 64).text


def test_no_text_ends_the_script_or_the_table() -> None:
    chart = Chart("c", "</script><b>", "x", "y", (Series("s", (Mark(1.0, 2.0, "</script>"),)),))
    page = html_page("<title>", "&", (chart,))
    assert page.count("</script>") == 1 and "&lt;title&gt;" in page
    assert table(("a", "b"), [("1|2", "3")]) == "| a | b |\n| --- | --- |\n| 1/2 | 3 |"


def test_results_are_of_one_set_of_weights(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    ResultFile(path, "old").add("x", {"y": 1})
    fresh = ResultFile(path, "new")
    assert fresh.known() == {}
    fresh.add("x", {"y": 2})
    assert ResultFile(path, "new").known() == {"x": {"y": 2}}
    path.write_text("[1]\n{}\n")
    with pytest.raises(InputError, match=r"r\.jsonl: not results of this version"):
        ResultFile(path, "new")


def test_panels_are_drawn_beside_each_other(tmp_path: Path) -> None:
    line = Series("full", (Mark(0.1, 20.0, "lambda 0.01"), Mark(1.0, 22.0, "lambda 0.001")))
    write_panels([Chart("panel", "title", "bits", "dB", (line,), has_log_x=True)] * 3, tmp_path / "panels.png")
    with Image.open(tmp_path / "panels.png") as picture:
        assert picture.size == (1200, 380)


def test_seconds_of_a_step_that_comes_again_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([10.0, 11.0, 13.0, 16.0, 20.0])
    monkeypatch.setattr(machine, "perf_counter", lambda: next(times))
    clock = StepClock()
    for task in ("matching", "coding", "matching"):
        clock(task, 0.0)
    clock.close()
    assert clock.seconds == {"start": 1.0, "matching": 2.0 + 4.0, "coding": 3.0}


@pytest.mark.skipif(sys.platform != "linux", reason="malloc of glibc")
def test_the_peak_of_one_measurement_is_without_what_an_earlier_one_freed() -> None:
    blocks = [bytes([number % 7 + 1]) * 100_000 for number in range(2000)]  # on the heap, which keeps what is below
    last = blocks.pop()  # this one
    forget_peak()
    of_blocks = peak_mib()
    blocks.clear()
    forget_peak()
    freed = peak_mib()
    assert len(last) and of_blocks and freed and freed < of_blocks - 150


@pytest.mark.parametrize(
    ("root", "sentence"), [("nowhere", "nowhere: there is no such folder"), (".", r"index\.json: cannot be read")]
)
def test_wrong_paths_are_refused_before_anything_is_measured(tmp_path: Path, root: str, sentence: str) -> None:
    plan = ReportPlan(tmp_path / root, tmp_path / "index.json", tmp_path, tmp_path / "work", tmp_path / "docs")
    with pytest.raises(InputError, match=sentence):
        make.make_report(plan, lambda study: pytest.fail(study))
