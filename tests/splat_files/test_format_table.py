"""Everything that names output formats follows from their table: writing, help, refusals, batch, documentation."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fecocodec.errors import OutputError
from fecocodec.splat_files import output_formats
from fecocodec.splat_files.gaussian_files import write_gaussians
from fecocodec.splat_files.output_formats import FORMATS, format_of, table_of_formats
from tests.splat_files.test_output_formats import some_gaussians
from tests.vectors.tiny_model import VECTORS

ROOT = Path(__file__).resolve().parents[2]
SCENE = VECTORS / "valid" / "scene-compact-6.fcs"

# Adds one file to the folder of formats and one entry to the table, then runs command lines and prints what they print.
COMMANDS = """
import contextlib, importlib.util, io, json, sys
from pathlib import Path
import fecocodec.splat_files
fecocodec.splat_files.__path__.append(sys.argv[1])
specification = importlib.util.find_spec("fecocodec.splat_files.output_formats")
text = Path(specification.origin).read_text()
entry = 'OutputFormat(".xyz", "centres", "centres alone", "centres as text", "exact", RDF, may_be_empty=True)'
assert text.count("FORMATS = (\\n    PLY,\\n") == 1
module = importlib.util.module_from_spec(specification)
sys.modules[specification.name] = module
exec(text.replace("FORMATS = (\\n    PLY,\\n", "FORMATS = (\\n    PLY,\\n    " + entry + ",\\n"), module.__dict__)
from fecosplat_cli.main import run
results = []
for arguments in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = run(arguments)
    results.append((code, out.getvalue() + err.getvalue()))
print(json.dumps(results))
"""
NEW_FILE = """
def file_bytes(scene):
    return "".join(f"{x} {y} {z}\\n" for x, y, z in scene.gaussians.means).encode()
"""


def test_a_format_is_one_file_and_one_entry(tmp_path: Path) -> None:
    output, coded = tmp_path / "scene.xyz", tmp_path / "coded"
    for folder in ("added", "coded"):
        (tmp_path / folder).mkdir()
    (tmp_path / "added" / "centres.py").write_text(NEW_FILE)
    (coded / "a.fcs").write_bytes(SCENE.read_bytes())
    commands = (
        ("decode", SCENE, "-o", output),
        ("batch", "decode", coded, "-o", tmp_path / "many", "--format", "xyz", "--shard", "1/1"),
        ("decode", "--help"),
        ("batch", "decode", "--help"),
        ("decode", SCENE, "-o", tmp_path / "a.obj"),
    )
    result = subprocess.run(
        [sys.executable, "-c", COMMANDS, tmp_path / "added"],
        input=json.dumps([[str(word) for word in command] for command in commands]),
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    codes, printed = zip(*json.loads(result.stdout), strict=True)
    assert codes == (0, 0, 0, 0, 1), printed
    assert len(output.read_text().splitlines()) > 1000 and output.read_text().count(" ") > 2000
    assert (tmp_path / "many" / "a.xyz").read_bytes() == output.read_bytes()
    assert ".xyz (centres alone)" in " ".join(printed[2].split())
    assert "[ply|xyz|compressed.ply|" in printed[3]
    assert "use .ply or .xyz or .compressed.ply or " in printed[4]


def test_the_documentation_has_the_table() -> None:
    assert table_of_formats() in (ROOT / "docs/output_formats.md").read_text("utf-8")


@pytest.mark.parametrize("of", FORMATS, ids=lambda of: of.ending)
def test_the_ending_selects_the_format(of: output_formats.OutputFormat) -> None:
    assert format_of(Path(f"a.b{of.ending}")) is of
    assert format_of(Path(f"A{of.ending.upper()}")) is of


@pytest.mark.parametrize("name", ["scene", "scene.v2", "compressed.ply", "-"])
def test_other_names_get_a_ply(name: str) -> None:
    assert format_of(Path(name)) is output_formats.PLY


def test_a_page_needs_cameras(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"a page needs cameras to look from; give them, or"):
        write_gaussians(tmp_path / "scene.html", some_gaussians(count=5))
    assert not list(tmp_path.iterdir())
