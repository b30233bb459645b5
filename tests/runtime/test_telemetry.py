"""Decoding must not report to anybody: wheels of onnxruntime do, unless they are told not to before the import."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = "from cli.process import prepare_process; prepare_process(); import fecocodec.runtime.graphs"


def test_a_command_leaves_nothing_in_the_home_folder(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "ORT_"))}
    subprocess.run(
        [sys.executable, "-B", "-c", PROGRAM],
        env={**environment, "HOME": str(tmp_path)},
        check=True,
    )
    assert list(tmp_path.rglob("*")) == []
