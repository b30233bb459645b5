"""`fecosplat decode` and `info` work where torch is not installed; other commands name what to install.

Decoding must not report to anybody: wheels of onnxruntime do, unless they are told not to before the import.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vectors.tiny_model import VECTORS

ROOT = Path(__file__).resolve().parents[2]
SCENE = VECTORS / "valid" / "scene-compact-6.fcs"
# Runs the command in a process in which the sender's libraries cannot be imported.
COMMAND = """
import sys
MISSING = {"torch", "numba", "scipy", "safetensors", "PIL", "OpenEXR", "matplotlib", "onnx", "onnxscript"}
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
from fecosplat_cli.main import run
sys.exit(run(sys.argv[1:]))
"""


def fecosplat(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", COMMAND, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("ending", ["ply", "compressed.ply", "spz", "glb"])
def test_decode_writes_every_format(ending: str, tmp_path: Path) -> None:
    output = tmp_path / f"scene.{ending}"
    result = fecosplat("decode", SCENE, "-o", output, "--save-cameras", tmp_path / "cameras.json")
    assert result.returncode == 0, result.stderr
    assert output.stat().st_size > 10_000 and (tmp_path / "cameras.json").stat().st_size > 100


@pytest.mark.parametrize("options", [["--stages", "1"], ["--partial"], ["--sh-degree", "0"], ["--no-merge"]])
def test_decode_takes_its_options(options: list[str], tmp_path: Path) -> None:
    result = fecosplat("decode", SCENE, "-o", tmp_path / "scene.ply", *options)
    assert result.returncode == 0, result.stderr


def test_info_describes_a_file() -> None:
    result = fecosplat("info", SCENE, "--json")
    assert result.returncode == 0 and '"views"' in result.stdout, result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["encode", "examples/motorcycle", "-o", "{}.fcs"], id="encode"),
        pytest.param(["render", str(SCENE), "-o", "{}"], id="render"),
        pytest.param(["decode", str(SCENE), "-o", "{}.ply", "--device", "cuda"], id="cuda"),
        pytest.param(["decode", str(SCENE), "-o", "{}.sog"], id="sog"),
        pytest.param(["info", "--parameters"], id="parameters"),
    ],
)
def test_what_needs_more_names_what_to_install(arguments: list[str], tmp_path: Path) -> None:
    output = str(tmp_path / "out")
    result = fecosplat(*(argument.replace("{}", output) for argument in arguments))
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1 and "pip install '.[sender]'" in result.stderr, result.stderr


PROGRAM = "from cli.process import prepare_process; prepare_process(); import fecocodec.runtime.graphs"


def test_a_command_leaves_nothing_in_the_home_folder(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "ORT_"))}
    subprocess.run(
        [sys.executable, "-B", "-c", PROGRAM],
        env={**environment, "HOME": str(tmp_path)},
        check=True,
    )
    assert list(tmp_path.rglob("*")) == []
