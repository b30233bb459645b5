"""`fecosplat decode` and `info` work where torch is not installed; other commands name what to install.

Decoding must not report to anybody: wheels of onnxruntime do, unless they are told not to before the import.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.vectors.tiny_model import VECTORS

ROOT = Path(__file__).resolve().parents[2]
SCENE = VECTORS / "valid" / "scene-compact-6.fcs"
# Runs commands one after the other in a process in which the sender's libraries cannot be imported, and prints code,
# standard output and standard error of each as JSON.
COMMANDS = """
import contextlib, io, json, sys
MISSING = {"torch", "numba", "scipy", "safetensors", "PIL", "OpenEXR", "matplotlib", "onnx", "onnxscript"}
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
from fecosplat_cli.main import run

def result(arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = run(arguments)
    return code, out.getvalue(), err.getvalue()

print(json.dumps([result(arguments) for arguments in json.load(sys.stdin)]))
"""


def fecosplat(*commands: list[str | Path]) -> list[tuple[int, str, str]]:
    given = json.dumps([[str(argument) for argument in command] for command in commands])
    command = [sys.executable, "-c", COMMANDS]
    return json.loads(subprocess.run(command, cwd=ROOT, input=given, capture_output=True, text=True, check=True).stdout)


def test_decode_and_info_take_their_options_and_write_every_format(tmp_path: Path) -> None:
    outputs = [tmp_path / f"scene.{ending}" for ending in ("ply", "compressed.ply", "spz", "glb")]
    cameras = [output.with_name(f"{output.name}.json") for output in outputs]
    commands = [["decode", SCENE, "-o", *pair] for pair in zip(outputs, ["--save-cameras"] * 4, cameras, strict=True)]
    options = [["--stages", "1"], ["--partial"], ["--sh-degree", "0"], ["--no-merge"]]
    commands += [["decode", SCENE, "-o", tmp_path / f"{number}.ply", *given] for number, given in enumerate(options)]
    results = fecosplat(*commands, ["info", SCENE, "--json"])
    assert [code for code, *_ in results] == [0] * 9, [err for *_, err in results]
    assert all(output.stat().st_size > 10_000 for output in outputs)
    assert all(saved.stat().st_size > 100 for saved in cameras)
    assert '"views"' in results[-1][1]


def test_what_needs_more_names_what_to_install(tmp_path: Path) -> None:
    commands: list[list[str | Path]] = [
        ["encode", "examples/motorcycle", "-o", tmp_path / "out.fcs"],
        ["render", SCENE, "-o", tmp_path / "out"],
        ["decode", SCENE, "-o", tmp_path / "out.ply", "--device", "cuda"],
        ["info", "--parameters"],
    ]
    for command, (code, _, err) in zip(commands, fecosplat(*commands), strict=True):
        assert code == 1, command
        assert err.count("\n") == 1 and "pip install '.[sender]'" in err, err
    ((code, _, err),) = fecosplat(["decode", SCENE, "-o", tmp_path / "out.sog"])
    assert code == 1 and err.endswith(
        "out.sog: .sog files need pillow and scipy, and pillow is not installed; run pip install pillow scipy.\n"
    )


PROGRAM = "from cli.process import prepare_process; prepare_process(); import fecocodec.runtime.graphs"


def test_a_command_leaves_nothing_in_the_home_folder(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "ORT_"))}
    subprocess.run(
        [sys.executable, "-B", "-c", PROGRAM],
        env={**environment, "HOME": str(tmp_path)},
        check=True,
    )
    assert list(tmp_path.rglob("*")) == []
