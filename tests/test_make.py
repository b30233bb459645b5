"""Targets of the Makefile refuse missing inputs before they make the environment."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize(
    ("target", "given", "said"),
    [
        ("report", [], "ROOT=: no such folder of scenes; write ROOT=folder INDEX=index.json."),
        ("report", ["ROOT=.", "INDEX=nowhere"], "INDEX=nowhere: no such file; write ROOT=folder"),
        ("stress", ["ROOT=nowhere", "INDEX=Makefile"], "ROOT=nowhere: no such folder of scenes; write ROOT=folder"),
        ("train", [], "PHOTOGRAPHS=: no such folder of posed scenes; write PHOTOGRAPHS=folder."),
    ],
)
def test_missing_inputs_are_refused_first(target: str, given: list[str], said: str, tmp_path: Path) -> None:
    command = ["make", target, *given, f"VENV={tmp_path / 'venv'}", "PYTHON="]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 2 and said in result.stderr
