"""What a command sets for its own process: only what the environment leaves open, and before torch is loaded."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fecosplat_cli.process import prepare_process


@pytest.mark.parametrize(("given", "kept"), [("7", "7"), (None, "10000")])
def test_the_environment_has_the_first_word(given: str | None, kept: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MALLOC_ARENA_MAX", "4")  # leaves memory as it is, also that of these tests
    monkeypatch.setenv("GOMP_SPINCOUNT", given or "")
    if given is None:
        monkeypatch.delenv("GOMP_SPINCOUNT")
    prepare_process()
    assert os.environ["GOMP_SPINCOUNT"] == kept


def test_torch_is_loaded_after_it() -> None:
    code = "import sys, fecosplat_cli.main; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path.home(), check=False).returncode == 0
