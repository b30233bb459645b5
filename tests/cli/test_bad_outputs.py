"""Results that cannot be written: one sentence that names the file, and nothing left behind."""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from refusals import assert_refused

from tests.vectors.tiny_model import VECTORS


@pytest.fixture
def full_disk(output: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[int, str], None]:
    """Call `full_disk(number, suffix)` for the disk to be full when that file, counted from 0, is written.

    The temporary name that the file will have leads to /dev/full, where the system refuses every write for want of
    space.
    """
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    names = (f"{number:012x}" for number in range(100))
    monkeypatch.setattr("fecocodec.atomic.secrets.token_hex", lambda _: next(names))

    def fill(number: int, suffix: str) -> None:
        (output / f".{number:012x}.part{suffix}").symlink_to("/dev/full")

    return fill


@pytest.fixture
def full_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is space for the contents of a file, but none for its name."""

    def refuse(source: object, target: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("fecocodec.atomic.os.link", refuse)
    monkeypatch.setattr("fecocodec.atomic.os.replace", refuse)


FAST = ("--views", "0,1", "--guides", "none", "--stages", "1", "--effort", "fast")
NO_SPACE = "writing failed (No space left on device); check free space and permissions or choose another output path."


def test_full_disk_leaves_no_new_folder_of_images(fecosplat, wall_file: Path, output: Path, full_folder) -> None:
    result = fecosplat("render", wall_file, "-o", output / "new" / "images")
    assert_refused(result, output, f"{output / 'new/images/wall_00.png'}: {NO_SPACE}")


def test_a_folder_for_images_that_cannot_be_made(fecosplat, wall_file: Path, output: Path) -> None:
    images = wall_file / "images"
    sentence = f"{images}: the folder cannot be made (Not a directory); choose another output path."
    assert_refused(fecosplat("render", wall_file, "-o", images), output, sentence)


@pytest.mark.parametrize(("number", "name"), [(0, "wall_00.png"), (2, "wall_01.png"), (3, "wall_01.exr")])
def test_full_disk_when_rendering_leaves_no_view(fecosplat, wall_file, output, full_disk, number, name) -> None:
    full_disk(number, Path(name).suffix)
    assert_refused(fecosplat("render", wall_file, "-o", output), output, f"{output / name}: {NO_SPACE}")


@pytest.mark.parametrize("name", ["a.fcs", "a.ply", "a.png"])
def test_folders_are_made_for_a_file_and_go_again_on_failure(fecosplat, photographs, wall_file, output, request, name):
    file, cameras = output / "new" / "folder" / name, output / "cameras" / "cameras.json"
    arguments = {
        "a.fcs": ("encode", photographs, *FAST),
        "a.ply": ("decode", wall_file, "--save-cameras", cameras),
        "a.png": ("render", wall_file),
    }[name]
    result = fecosplat(*arguments, "-o", file)
    assert result.code == 0 and file.is_file(), result.err
    assert cameras.is_file() == (name == "a.ply")

    shutil.rmtree(output)
    output.mkdir()
    request.getfixturevalue("full_folder")
    result = fecosplat(*arguments, "-o", file)
    assert (result.code, list(output.iterdir())) == (1, [])
    written_first = cameras if name == "a.ply" else file
    assert result.err.endswith(f"fecosplat: {written_first}: {NO_SPACE}\n")  # encode has warned before


@pytest.mark.parametrize("command", ["encode", "decode", "render"])
def test_output_that_exists(fecosplat, photographs, stream_file, tmp_path, output, command) -> None:
    existing = tmp_path / "result.png"
    existing.write_text("precious")
    source = stream_file if command == "render" else tmp_path / "never read"
    cameras = ("--cameras", photographs, "--views", "view_0.png") if command == "render" else ()
    result = fecosplat(command, source, "-o", existing, *cameras)
    assert_refused(
        result, output, f"{existing}: the file exists already; choose another output path or replace it by --overwrite."
    )
    assert existing.read_text() == "precious"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_full_disk_behind_standard_output(stream_file: Path, options: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "fecosplat_cli", "info", stream_file, *options]
    with open("/dev/full", "w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert result.stderr == (
        "fecosplat: standard output: writing failed (No space left on device); check free space or send it elsewhere.\n"
    )
    assert result.returncode == 1


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_away_is_no_success(unbuffered: str) -> None:
    """Without Python's buffer, a write to a pipe ends early and without an error when the reader closes it."""
    file = VECTORS / "valid" / "scene-compact-6.fcs"
    command = [sys.executable, "-m", "fecosplat_cli", "decode", str(file), "-o", "-"]
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as child:
        assert child.stdout is not None and child.stderr is not None
        child.stdout.read(100)
        child.stdout.close()
        message = child.stderr.read()
    assert (child.returncode, message) == (1, b"")
