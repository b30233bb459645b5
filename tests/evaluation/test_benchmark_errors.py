"""Benchmark scripts end with one sentence, not a traceback, if their input cannot be used."""

import runpy
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
ONE_PAIR = '{"a": {"context": [0, 2], "target": [1]}}'


@pytest.mark.parametrize(
    ("script", "index", "options", "sentence"),
    [
        ("dev_scores.py", "index.jsn", (), r"index\.jsn: cannot be read"),
        ("dev_scores.py", "index.json", ("--views", "3"), r"index\.json: has no entry with 3 context views"),
        ("dev_scores.py", "index.json", ("--guided",), r"index\.json: no entry with 2 views has `guide`"),
        ("make_report.py", "index.json", (), r"scenes: there is no such folder"),
    ],
)
def test_one_sentence(
    script: str, index: str, options: tuple[str, ...], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "index.json").write_text(ONE_PAIR)
    before = ["model"] if script == "dev_scores.py" else []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [script, *before, "scenes", index, *options])
    with pytest.raises(SystemExit, match=sentence):
        runpy.run_path(str(BENCHMARKS / script), run_name="__main__")
