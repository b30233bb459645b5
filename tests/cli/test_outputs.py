"""What `-o` may be: endings that are not written are refused before any work, and `-` is standard output.

Where `decode` writes, and that no text of a stranger's file reaches what it writes.
"""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import assert_refused

from fecocodec.container import with_metadata
from fecocodec.photographs.images import read_image
from fecocodec.splat_files.ply import read_ply
from tests.vectors.tiny_model import VECTORS

SCENE = VECTORS / "valid" / "scene-compact-6.fcs"


def test_output_paths_with_control_characters_are_shown_escaped(fecosplat, output: Path) -> None:
    for command, name in (("decode", "a\n\x1b[2Jb.ply"), ("render", "a\n\x1b[2Jb.png")):
        result = fecosplat(command, SCENE, "-o", output / name)
        assert result.code == 0 and (output / name).exists()
        assert result.err.count("\n") == 1 and f"{output}/a\\n\\x1b[2Jb.p" in result.err


@pytest.mark.parametrize("command", ["encode", "render"])
def test_standard_output_is_refused_where_it_is_not_meant(
    fecosplat, photographs: Path, output: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(output)
    result = fecosplat(command, photographs if command == "encode" else SCENE, "-o", "-")
    assert_refused(result, output, "-: the result is not written to standard output; give the name of a file.")


def test_decode_writes_to_standard_output(fecosplat, output: Path) -> None:
    command = [sys.executable, "-m", "fecosplat_cli", "decode", SCENE, "-o"]
    piped = subprocess.run([*command, "-"], capture_output=True, check=True)
    assert fecosplat("decode", SCENE, "-o", output / "a.ply").code == 0
    assert piped.stdout == (output / "a.ply").read_bytes()
    assert read_ply(output / "a.ply").count > 0
    assert piped.stderr.startswith(b"-: ")


def test_decode_to_a_terminal_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from fecosplat_cli.output import write_stdout

    from fecocodec.errors import OutputError

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdout", Terminal())
    with pytest.raises(OutputError, match="standard output: this is a terminal"):
        write_stdout(b"data")


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_render_writes_one_picture(fecosplat, photographs: Path, output: Path, name: str) -> None:
    arguments = ("--cameras", photographs, "--views", "1,")
    assert fecosplat("render", SCENE, "-o", output / name, *arguments).code == 0
    assert [path.name for path in output.iterdir()] == [name]
    assert read_image(output / name).shape == (3, 64, 96)


@pytest.mark.usefixtures("networks")
def test_a_file_is_decoded_beside_it_by_default(fecosplat, wall: bytes, tmp_path: Path) -> None:
    (tmp_path / "my wall.fcs").write_bytes(wall)
    result = fecosplat("decode", tmp_path / "my wall.fcs")
    assert (result.code, (tmp_path / "my wall.ply").read_bytes()[:4]) == (0, b"ply\n")
    assert result.err.startswith(f"{tmp_path / 'my wall.ply'}: ")


@pytest.mark.usefixtures("networks")
def test_title_and_author_of_a_stranger_reach_no_output(fecosplat, wall, tmp_path, monkeypatch) -> None:
    """Files of Gaussians and pages are the same with and without metadata."""
    monkeypatch.setattr("fecocodec.splat_files.html_page.scene_page", lambda: b"/*SCENE*/ /*GAUSSIANS*/")
    evil = "</script><script>alert(1)</script>\x1b]0;owned\x07\x00"
    (tmp_path / "named").mkdir()
    (tmp_path / "named" / "wall.fcs").write_bytes(with_metadata(wall, {"title": evil, "author": evil}))
    (tmp_path / "wall.fcs").write_bytes(wall)
    for name in ("wall.glb", "wall.html", "wall.ply"):
        for folder in (tmp_path, tmp_path / "named"):
            result = fecosplat("decode", folder / "wall.fcs", "-o", folder / name)
            assert result.code == 0 and "alert" not in result.err and "\x1b" not in result.err
        assert (tmp_path / "named" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_a_process_without_a_console_decodes(output: Path) -> None:
    """As of pythonw and daemons; the first files that are opened would take the places of closed streams."""
    command = f'"{sys.executable}" -m fecosplat_cli decode "{SCENE}" -o "{output / "a.ply"}" <&- >&- 2>&-'
    assert subprocess.run(command, shell=True).returncode == 0
    assert len(read_ply(output / "a.ply").means) > 0


def test_letters_that_a_console_lacks_are_replaced(stream_file: Path, tmp_path: Path) -> None:
    titled = tmp_path / "titled.fcs"
    titled.write_bytes(with_metadata(stream_file.read_bytes(), {"title": "caf\u00e9 \u53f0\u6240"}))
    command = [sys.executable, "-m", "fecosplat_cli", "info", titled]
    result = subprocess.run(command, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "cp1252"})
    assert (result.returncode, result.stderr) == (0, b"")
    assert b"caf\xe9 ??" in result.stdout
