"""What holds for every command: help, versions, exit codes, and failures that leave nothing behind."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from fecosplat_cli.main import COMMANDS, run

import fecocodec

CONSOLE_SCRIPT = Path(sys.executable).with_name("fecosplat")


@pytest.mark.parametrize("command", [[CONSOLE_SCRIPT], [sys.executable, "-m", "fecosplat_cli"]])
def test_the_script_and_the_module_run(command: list) -> None:
    result = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert result.stdout == f"fecosplat {fecocodec.__version__}\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("enc", "plain,encode"),
        ("encode --eff", "plain,--effort"),
        ("view --no", "plain,--no-browser"),
        ("info sc", "file,sc"),  # in bash, this answer makes the shell list files itself
        ("encode sc", "file,sc"),
    ],
)
def test_the_shell_completes(words: str, expected: str, monkeypatch, capsys) -> None:
    """words: after the name of the program; the last one is to be completed."""
    monkeypatch.setenv("_FECOSPLAT_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", f"fecosplat {words}")
    monkeypatch.setenv("COMP_CWORD", str(len(words.split())))
    with pytest.raises(SystemExit):
        run([])
    assert capsys.readouterr().out.splitlines() == [expected]


def test_help_lists_every_command(fecosplat) -> None:
    result = fecosplat("--help")
    assert result.code == 0
    for command in COMMANDS:
        assert f"\n  {command} " in result.out


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_examples(fecosplat, command: str) -> None:
    result = fecosplat(command, "--help")
    assert result.code == 0
    assert result.out.count(f"fecosplat {command} ") >= 3


EXAMPLE = Path(__file__).parents[2] / "examples" / "motorcycle"
WITH_CAMERAS = ("encode", str(EXAMPLE), "-o", "a.fcs")
WITHOUT_CAMERAS = ("encode", str(EXAMPLE / "images"), "-o", "a.fcs")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("encod", "photos"), "No such command 'encod'"),
        (("encode", "photos"), "Missing option '-o'"),
        (("encode", "-o", "a.fcs"), "Missing argument 'VIEWS'"),
        (("encode", "photos", "-o", "a.fcs", "--size", "256"), "'256' is not WIDTHxHEIGHT, such as 448x256"),
        (("encode", "photos", "-o", "a.fcs", "--views", "0,,5"), "'0,,5' names an empty view"),
        (("encode", "photos", "-o", "a.fcs", "--stages", "3"), "3 is not in the range 1<=x<=2"),
        (("encode", "photos", "-o", "a.fcs", "--threads", "0"), "0 is not in the range 1<=x<=1024"),
        (("encode", "", "-o", "a.fcs"), "Invalid value for 'VIEWS': the path is empty; name a file or folder"),
        (("encode", "photos", "-o", ""), "Invalid value for '-o' / '--output': the path is empty"),
        (("render", "a.fcs", "-o", ""), "the path is empty"),
        (("decode", "", "-o", "a.ply"), "Invalid value for 'FILE.fcs': the path is empty; name a file or folder"),
        (("batch", "encode", "", "-o", "out"), "the path is empty"),
        (("encode", "photos", "-o", "a.fcs", "--model", ""), "the path is empty"),
        (("encode", "photos", "-o", "a.fcs", "--near", "-1"), "-1.0 is not in the range x>0"),
        (("encode", "photos", "-o", "a.fcs", "--far", "0"), "0.0 is not in the range x>0"),
        ((*WITH_CAMERAS, "--save-cameras", "cameras.json"), "this folder has cameras"),
        ((*WITH_CAMERAS, "--focal-px", "515"), "--focal-px is for photographs without cameras; this folder has cam"),
        ((*WITH_CAMERAS, "--date", "yesterday"), "is not a date like"),
        ((*WITHOUT_CAMERAS, "--frames", "4"), "--frames is for a video file"),
        ((*WITHOUT_CAMERAS, "--save-frames", "frames"), "--save-frames is for a video file"),
        ((*WITH_CAMERAS, "--checks", "many"), "'many' is neither a number of photographs nor none."),
        ((*WITH_CAMERAS, "--guides", "0,,1"), "names an empty view"),
        ((*WITH_CAMERAS, "--views", "all", "--guides", "1"), "--views all codes every photograph; leave out --guides"),
        ((*WITH_CAMERAS, "--target-kib", "8", "--target-psnr", "25"), "exclude each other"),
        ((*WITH_CAMERAS, "--effort", "fast", "--sharpness", "1"), "--sharpness needs the steps that --effort fast lea"),
        ((*WITH_CAMERAS, "--effort", "fast", "--sharpness", "-0.5"), "--sharpness needs the steps that --effort fast"),
        ((*WITH_CAMERAS, "--sharpness", "1.5"), "1.5 is not in the range -1.0<=x<=1.0"),
        ((*WITH_CAMERAS, "--target-kib", "8", "--stages", "1"), "has no rate control"),
        ((*WITH_CAMERAS, "--target-kib", "8", "--lambda", "1e-3"), "leave out --lambda"),
        (("decode", "a.fcs", "-o", "a.ply", "--device", "gpu"), "'gpu' is none of cpu, cuda, cuda:N"),
        (("decode", "a.fcs", "-o", "a.ply", "--partial", "--stages", "1"), "leave --stages out"),
        (("decode", "a.fcs", "-o", "-", "--json"), "leave --json out"),
        (("decode", "-"), "Give -o"),
        (("info",), "Give either a .fcs file or --parameters."),
        (("info", "scene.fcs", "--parameters"), "Give either a .fcs file or --parameters."),
        (("render", "scene.ply", "-o", "out"), "A .ply file needs --cameras"),
        (("render", "scene.fcs", "-o", "out", "--views", "0"), "--views needs --cameras"),
        (("render", "a.ply", "-o", "out", "--cameras", "b", "--model", "c"), "leave them out for a .ply file"),
        (("render", "a.ply", "-o", "out", "--cameras", "b", "--stages", "1"), "leave them out for a .ply file"),
        (("render", "a.ply", "--cameras", "b"), "Give -o for images, --video for a video"),
        (("render", "a.ply", "--cameras", "b", "-o", "out", "--frames", "5"), "--frames is for --path"),
        (("render", "a.ply", "--cameras", "b", "-o", "out", "--fps", "5"), "--fps for --video"),
        (("view", "a.ply", "--decode-in-browser"), "--decode-in-browser sends a .fcs file, and decodes it with a mo"),
        (("view", "a.fcs", "--model", "b", "--decode-in-browser"), "decodes it with a model that ships."),
        (("eval", "a", "--index", "i.json", "-o", "out", "--lambdas", "small"), "--lambdas"),
        (("train", "run", "--views", "two"), "--views"),
        (("train", "run", "--perceptual", "vgg"), "--perceptual"),
        (("train", "run", "--size", "128"), "--size"),
        (("train", "run", "--max-minutes", "0"), "--max-minutes"),
        (("train", "run", "--precision", "half"), "--precision"),
        (("train", "detail", "a", "b"), "fecosplat train detail"),
        (("train", "steps", "a"), "fecosplat train steps"),
        (("train", "steps", "a", "b", "--sharp", "more"), "fecosplat train steps"),
    ],
)
def test_wrong_usage_exits_with_2(fecosplat, arguments: tuple[str, ...], message: str, output: Path, monkeypatch):
    monkeypatch.chdir(output)
    result = fecosplat(*arguments)
    assert (result.code, result.out, list(output.iterdir())) == (2, "", [])
    assert message in result.err
    assert "Traceback" not in result.err


def test_stream_that_is_a_folder_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("info", tmp_path)
    assert (result.code, result.err) == (1, f"fecosplat: {tmp_path}: is a folder; give a .fcs file.\n")


def test_missing_device_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("encode", tmp_path, "-o", tmp_path / "a.fcs", "--device", "cuda:99")
    assert result.code == 1
    assert result.err.startswith("fecosplat: device cuda:99 was asked for, but torch sees ")
    assert list(tmp_path.iterdir()) == []


def test_interrupt_exits_with_130(tmp_path: Path) -> None:
    """Ctrl-C while a command waits for its input: a pipe to which nobody writes."""
    pipe = tmp_path / "scene.fcs"
    os.mkfifo(pipe)
    # Whoever runs the tests in the background has Ctrl-C ignored, and children inherit that.
    heed_interrupts = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        [CONSOLE_SCRIPT, "info", pipe], stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts
    )
    writer = os.open(pipe, os.O_WRONLY)  # returns when the command has opened the pipe, so it is reading
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    os.close(writer)
    assert process.returncode == 130
    assert err.strip() == "fecosplat: interrupted"
