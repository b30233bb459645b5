"""`fecosplat stress` writes a table, names broken rules, and refuses before it works."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from fecocodec.evaluation.stress import suite
from fecocodec.evaluation.stress.suite import Verdict
from tests.cli.conftest import CommandLine
from tests.example_scenes import MODEL


def verdicts(*_arguments: object) -> Iterator[tuple[Verdict, float]]:
    yield Verdict("wall: reference", "≤0", 20.0, 0.0, 3.5, 0.4, 3.4, 0, ""), 0.5
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
