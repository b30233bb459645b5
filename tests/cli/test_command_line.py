"""What holds for every command: help, versions, exit codes, and failures that leave nothing behind."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from fecosplat_cli.main import COMMANDS

import fecocodec

CONSOLE_SCRIPT = Path(sys.executable).with_name("fecosplat")


def test_console_script_is_installed() -> None:
    result = subprocess.run([CONSOLE_SCRIPT, "--version"], capture_output=True, text=True, check=True)
    assert result.stdout == f"fecosplat {fecocodec.__version__}\n"


def test_module_runs_like_the_script() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "fecosplat_cli", "--version"], capture_output=True, text=True, check=True
    )
    assert result.stdout == f"fecosplat {fecocodec.__version__}\n"


@pytest.mark.parametrize(
    ("words", "expected"), [("enc", "encode"), ("encode --eff", "--effort"), ("view --no", "--no-browser")]
)
def test_the_shell_completes_commands_and_options(words: str, expected: str) -> None:
    """words: after the name of the program; the last one is to be completed."""
    place = {"COMP_WORDS": f"fecosplat {words}", "COMP_CWORD": str(len(words.split()))}
    environment = os.environ | place | {"_FECOSPLAT_COMPLETE": "bash_complete"}
    result = subprocess.run([CONSOLE_SCRIPT], capture_output=True, text=True, check=True, env=environment)
    assert result.stdout.splitlines() == [f"plain,{expected}"]


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


def test_help_loads_no_numeric_library() -> None:
    program = (
        "import sys; from fecosplat_cli.main import run; run(['--help']); "
        "print(sorted({'torch', 'numpy', 'rich'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "[]"


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
        (("decode", "a.fcs", "-o", "a.ply", "--device", "gpu"), "'gpu' is none of cpu, cuda, cuda:N"),
        (("render", "scene.ply", "-o", "out"), "A .ply file needs --cameras"),
        (("render", "scene.fcs", "-o", "out", "--views", "0"), "--views needs --cameras"),
        (("render", "a.ply", "-o", "out", "--cameras", "b", "--model", "c"), "leave them out for a .ply file"),
        (("render", "a.ply", "-o", "out", "--cameras", "b", "--stages", "1"), "leave them out for a .ply file"),
    ],
)
def test_wrong_usage_exits_with_2(fecosplat, arguments: tuple[str, ...], message: str) -> None:
    result = fecosplat(*arguments)
    assert (result.code, result.out) == (2, "")
    assert message in result.err
    assert "Traceback" not in result.err


def test_stream_that_is_a_folder_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("info", tmp_path)
    assert (result.code, result.err) == (1, f"fecosplat: {tmp_path}: is a folder; give a .fcs file.\n")


@pytest.mark.parametrize("lmbda", ["1e-6", "0.1", "-1", "nan", "0"])
def test_lambda_out_of_range_is_refused_before_reading(fecosplat, tmp_path: Path, lmbda: str) -> None:
    result = fecosplat("encode", tmp_path / "no such folder", "-o", tmp_path / "a.fcs", "--lambda", lmbda)
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("fecosplat: lambda is ")
    assert "1e-05 to 0.01" in result.err
    assert list(tmp_path.iterdir()) == []


def test_failed_overwrite_keeps_the_old_output(fecosplat, tmp_path: Path) -> None:
    output = tmp_path / "result.fcs"
    output.write_text("precious")
    result = fecosplat("encode", tmp_path / "no such folder", "-o", output, "--overwrite")
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {tmp_path / 'no such folder'}: no such folder")
    assert output.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [output]


def test_missing_device_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("encode", tmp_path, "-o", tmp_path / "a.fcs", "--device", "cuda:99")
    assert result.code == 1
    assert result.err.startswith("fecosplat: device cuda:99 was asked for, but torch sees ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["info", "encode"])
def test_shells_complete_names_of_files(command: str) -> None:
    """In bash, the answer `file` makes the shell list files itself."""
    line = {"COMP_WORDS": f"fecosplat {command} sc", "COMP_CWORD": "2", "_FECOSPLAT_COMPLETE": "bash_complete"}
    result = subprocess.run([CONSOLE_SCRIPT], env={**os.environ, **line}, capture_output=True, text=True, check=True)
    assert result.stdout == "file,sc\n"


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
