"""Killed, refused by the disk, or asked to replace the input: no file is damaged and none is lost."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import assert_refused

from fecocodec.splat_files.ply import read_ply
from tests.vectors.tiny_model import VECTORS

# Decodes until it writes, says so, and waits there to be killed: half of the output is on the disk then.
CHILD = """
import sys, time
from fecocodec import atomic

def stall(source, target):
    data = source.read_bytes()
    source.write_bytes(data[: len(data) // 2])
    print("writing", flush=True)
    time.sleep(600)

atomic.os.link = atomic.os.replace = stall
from fecosplat_cli.main import run
sys.exit(run(sys.argv[1:]))
"""


def test_a_killed_command_leaves_the_old_file_whole(output: Path) -> None:
    target = output / "a.ply"
    target.write_bytes(b"precious")
    arguments = ["decode", VECTORS / "valid" / "scene-compact-6.fcs", "-o", target, "--overwrite"]
    child = subprocess.Popen([sys.executable, "-c", CHILD, *arguments], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "writing\n"
    child.send_signal(signal.SIGKILL)
    child.wait(timeout=20)
    assert target.read_bytes() == b"precious"
    leftovers = [path.name for path in output.iterdir() if path != target]
    assert all(name.startswith(".") and ".part" in name for name in leftovers), "half a file under a name of its own"


def test_an_interrupted_command_leaves_nothing(fecosplat, wall_file, output, monkeypatch) -> None:
    def interrupt(source: object, target: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("fecocodec.atomic.os.link", interrupt)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # shells ignore it for what they start with &
    try:
        result = fecosplat("decode", wall_file, "-o", output / "a.ply")
    finally:
        signal.signal(signal.SIGINT, before)
    assert result.code == 130 and list(output.iterdir()) == []


def test_decoding_into_the_input_is_refused(fecosplat, wall: bytes, wall_file: Path, output: Path) -> None:
    link = wall_file.with_name("link.fcs")
    link.symlink_to(wall_file)
    for target in (wall_file, link, output / ".." / "wall.fcs"):
        result = fecosplat("decode", wall_file, "-o", target, "--overwrite")
        assert_refused(result, output, f"{target}: this is the input, or part of it; choose another output path.")
    assert wall_file.read_bytes() == wall


def test_encoding_into_a_photograph_is_refused(fecosplat, photographs: Path, output: Path) -> None:
    target = photographs / "view_0.png"
    before = target.read_bytes()
    result = fecosplat("encode", photographs, "-o", target, "--overwrite")
    assert_refused(result, output, f"{target}: this is the input, or part of it; choose another output path.")
    assert target.read_bytes() == before


@pytest.mark.usefixtures("networks")
def test_an_older_stream_among_the_photographs_may_be_replaced(fecosplat, photographs, wall, tmp_path, output) -> None:
    folder = shutil.copytree(photographs, tmp_path / "photographs")
    (folder / "a.fcs").write_bytes(b"old")
    arguments = ("--views", "0,1", "--stages", "1", "--effort", "fast", "--overwrite")
    assert fecosplat("encode", folder, "-o", folder / "a.fcs", *arguments).code == 0
    assert fecosplat("decode", folder / "a.fcs", "-o", output / "a.ply").code == 0
    assert read_ply(output / "a.ply").count > 0
