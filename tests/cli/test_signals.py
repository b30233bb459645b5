"""Signals end a command with one line and no part of a file, however early they come.

What a command sets for its own process: only what the environment leaves open, and before torch is loaded.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from fecosplat_cli.process import prepare_process

# Sends the signal to itself when a module is first imported, as a user who presses Ctrl-C at that moment does.
AT_IMPORT = """
import os, signal, sys
number, module = int(sys.argv.pop(1)), sys.argv.pop(1)
signal.signal(signal.SIGINT, signal.default_int_handler)

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), number)

from fecosplat_cli.main import main
sys.meta_path.insert(0, Interrupt())
main()
"""

# Writes half of an output file, says so, and waits.
WHILE_WRITING = """
import sys, time
from pathlib import Path
import fecosplat_cli.main as command
from fecocodec.atomic import write_atomically

def write(arguments=None):
    with write_atomically(Path(sys.argv[1]), overwrite=False) as temporary:
        temporary.write_bytes(b"half")
        print("writing", flush=True)
        time.sleep(60)

command.run = write
command.main()
"""
# Sends the signal to itself while cameras are estimated: when pycolmap is loaded and photographs are to be matched.
WHILE_ESTIMATING = """
import os, sys
import fecocodec.poses.pose_estimation as estimation
from fecosplat_cli.main import main

number, match = int(sys.argv.pop(1)), estimation.match_pairs

def interrupted(*arguments, **options):
    os.kill(os.getpid(), number)
    match(*arguments, **options)

estimation.match_pairs = interrupted
main()
"""
LINES = {
    signal.SIGINT: "fecosplat: interrupted\n",
    signal.SIGTERM: "fecosplat: terminated\n",
    signal.SIGHUP: "fecosplat: the terminal was closed\n",
}


@pytest.mark.parametrize("module", ["click", "torch"])
def test_ctrl_c_while_libraries_load_is_one_line(module: str, photographs: Path, output: Path) -> None:
    arguments = ["encode", photographs, "-o", output / "a.fcs"]
    command = [sys.executable, "-c", AT_IMPORT, str(int(signal.SIGINT)), module, *arguments]
    result = subprocess.run(command, capture_output=True, text=True)
    assert (result.returncode, result.stdout, result.stderr) == (130, "", LINES[signal.SIGINT])
    assert list(output.iterdir()) == []


@pytest.mark.parametrize("number", LINES)
def test_a_signal_while_writing_leaves_no_part_of_a_file(number: signal.Signals, output: Path) -> None:
    command = [sys.executable, "-c", WHILE_WRITING, output / "a.fcs"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_all)
    assert child.stdout is not None and child.stdout.readline() == "writing\n"
    assert [path.read_bytes() for path in output.iterdir()] == [b"half"]
    child.send_signal(number)
    _, err = child.communicate(timeout=20)
    assert (child.returncode, err) == (128 + number, LINES[number])
    assert list(output.iterdir()) == []


def test_sigterm_while_cameras_are_estimated_is_one_line(output: Path) -> None:
    """pycolmap installs a handler of its own for SIGTERM, which prints a stack."""
    pytest.importorskip("pycolmap")
    number = signal.SIGTERM
    photographs = Path(__file__).parents[2] / "examples" / "motorcycle" / "images"
    arguments = ["encode", photographs, "-o", output / "a.fcs", "--save-cameras", output / "cameras.json"]
    command = [sys.executable, "-c", WHILE_ESTIMATING, str(int(number)), *arguments]
    environment = os.environ | {"TMPDIR": str(output)}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, preexec_fn=heed_all)
    assert (result.returncode, result.stdout, result.stderr) == (128 + number, "", LINES[number])
    assert list(output.iterdir()) == []


def test_a_signal_waits_for_the_end_of_an_import(tmp_path: Path) -> None:
    """An exception through the C++ code of a library that is being imported would abort the process."""
    (tmp_path / "imported.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(0.2)\nprint('imported', flush=True)\n"
    )
    program = (
        "import time\n"
        "from fecosplat_cli.process import EndingSignals\n"
        "with EndingSignals() as signals:\n"
        "    try:\n"
        "        import imported\n"
        "        time.sleep(60)\n"
        "    except SystemExit:\n"
        "        print(signals.description)\n"
    )
    command = [sys.executable, "-c", program]
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, preexec_fn=heed_all, timeout=30)
    assert (result.returncode, result.stdout, result.stderr) == (0, "imported\ninterrupted\n", "")


def test_a_block_ends_in_its_own_way_before_a_signal_takes_effect() -> None:
    program = (
        "import os, signal\n"
        "from fecosplat_cli.process import EndingSignals, ending_later\n"
        "with EndingSignals() as signals:\n"
        "    try:\n"
        "        with ending_later() as is_ending:\n"
        "            print(is_ending())\n"
        "            os.kill(os.getpid(), signal.SIGTERM)\n"
        "            print(is_ending(), signals.received)\n"
        "        print('not reached')\n"
        "    except SystemExit as end:\n"
        "        print(end.code, signals.description)\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, preexec_fn=heed_all)
    assert (result.stdout, result.stderr) == ("False\nTrue None\n143 terminated\n", "")


def heed_all() -> None:
    """Whoever runs the tests in the background has signals ignored, and children inherit that."""
    for number in LINES:
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    """As `nohup` does with SIGHUP."""
    program = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from fecosplat_cli.process import EndingSignals\n"
        "with EndingSignals(): print(signal.getsignal(signal.SIGHUP) is signal.SIG_IGN)"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout == "True\n"


@pytest.mark.parametrize(("given", "kept"), [("7", "7"), (None, "10000")])
def test_the_environment_has_the_first_word(given: str | None, kept: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MALLOC_ARENA_MAX", "4")  # leaves memory as it is, also that of these tests
    monkeypatch.setenv("GOMP_SPINCOUNT", given or "")
    if given is None:
        monkeypatch.delenv("GOMP_SPINCOUNT")
    prepare_process()
    assert os.environ["GOMP_SPINCOUNT"] == kept
