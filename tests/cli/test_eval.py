"""`fecosplat eval` and `fecosplat stress` refuse before they measure, and name what failed and which rules broke."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fecocodec.evaluation import evaluation, run
from fecocodec.evaluation.evaluation import Report, write_tables
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.stress import suite
from fecocodec.evaluation.stress.suite import Verdict
from fecocodec.evaluation.summary import Comparison, ExternalRow, averages
from fecocodec.sender.optimisation_config import EFFORTS, FAST
from tests.chunk_files import write_wall_chunks
from tests.cli.conftest import CommandLine, Result
from tests.example_scenes import MODEL


def test_results_are_printed_and_failures_and_missing_weights_of_a_metric_named(
    fecosplat: CommandLine, random_weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "is_lpips_there", lambda trunk: trunk != "vgg16")
    monkeypatch.setattr(evaluation, "quality_charts", lambda *_: ())
    monkeypatch.setitem(EFFORTS, "default", FAST)
    root, index = write_wall_chunks(tmp_path / "chunks", num_scenes=1), tmp_path / "index.json"
    index.write_text(json.dumps({name: {"context": [0, 2], "target": [1]} for name in ("wall0", "gone")}))
    model = random_weights / MODEL
    arguments = ["eval", root, "--index", index, "-o", tmp_path / "out", "--model", model, "--size", "96x64"]
    result = fecosplat(*arguments, "--lambdas", "1e-2", "--no-strips")
    assert result.code == 1 and "ST-LPIPS  LPIPS  LPIPS (AlexNet)" in result.out
    assert "LPIPS (VGG16) was not measured: its weights are in a clone of the repository only" in result.err
    assert "gone, fecosplat, lambda 0.01:" in result.err and "1 measurements failed" in result.err
    result = fecosplat(*arguments, "--lambdas", "1e-2", "--no-strips", "--json")  # nothing is measured again
    (average,) = json.loads(result.out)["averages"]
    assert average["system"] == "fecosplat" and average["entries"] == 1 and average["kib"] > 0


@pytest.fixture
def printed(fecosplat: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Call `eval` on measurements that were made."""

    def call(report: Report, *options: object) -> Result:
        monkeypatch.setattr(evaluation, "evaluate_to_folder", lambda *_arguments: report)
        index = tmp_path / "index.json"
        index.write_text("{}")
        return fecosplat("eval", tmp_path, "--index", index, "-o", tmp_path / "out", *options)

    return call


def test_curves_with_little_in_common_are_not_said_to_have_nothing(printed: Callable[..., Result]) -> None:
    found = printed(Report((), (Comparison("AVIF", None, -0.5, None),), ()))
    assert "fecosplat against AVIF: less than 0.5 dB of PSNR in common, -0.50 dB at equal bytes" in found.err


def test_entries_with_warnings_are_named(printed: Callable[..., Result]) -> None:
    found = printed(Report((), (), (), doubtful=("a", "b", "c", "d", "e")))
    assert "entries.tsv: warnings at 5 of the entries (a, b, c and 2 more); see its column `warnings`." in found.err
    assert "warnings at" not in printed(Report((), (), ())).err + found.out


def test_external_results_are_listed_below_ours(printed: Callable[..., Result], tmp_path: Path) -> None:
    measurement = Measurement("a", "fecosplat", "lambda 0.01", "model", num_bytes=2048, psnr=20.0)
    report = Report(averages([measurement]), (), (), (ExternalRow("Other", "q 1", 4.0, psnr=19.5),))
    found = printed(report)
    ours, other = found.out.splitlines()[1:]
    assert ours.split()[:6] == ["fecosplat", "lambda", "0.01", "1", "2.00", "0.000"]
    assert other.split() == ["Other", "q", "1", "external", "4.00", "19.50"]
    assert json.loads(printed(report, "--json").out)["external"][0]["system"] == "Other"
    write_tables(tmp_path, [measurement], report)
    head, _ours, other = (line.split("\t") for line in (tmp_path / "summary.tsv").read_text().splitlines())
    cells = {name: cell for name, cell in zip(head, other, strict=True) if cell}
    assert cells == {"system": "Other", "setting": "q 1", "entries": "external", "kib": "4", "psnr": "19.5"}


def verdicts(*_arguments: object) -> Iterator[tuple[Verdict, float]]:
    yield Verdict("wall: reference", "≤0", 20.0, 0.0, 3.5, 0.4, 3.4), 0.5
    yield Verdict("wall: black", "warned", 40.0, -20.0, 1.5, 0.4, 1.6, 0, 'no warning says "black"'), 1.0


def test_the_table_is_written_and_broken_rules_are_named(
    fecosplat: CommandLine, random_weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(suite, "read_pairs", lambda *_arguments: {})
    monkeypatch.setattr(suite, "run_suite", verdicts)
    model, output, index = random_weights / MODEL, tmp_path / "out", tmp_path / "i.json"
    index.write_text("{}")
    result = fecosplat("stress", tmp_path, "--index", index, "-o", output, "--model", model)
    assert result.code == 1 and "1 of 2 cases hold" in result.err
    assert 'wall: black: no warning says "black"' in result.err
    header, *rows = (output / "stress.tsv").read_text().splitlines()
    assert header.startswith("case\trule\tpsnr\tlost") and len(rows) == 2
