"""Reading the bytes of a stream: files, pipelines, and named pipes with and without a program that writes to them."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fecocodec.container import read_stream_file, stream_file
from fecocodec.container.header_bytes import SIGNATURE
from fecocodec.errors import InputError

DATA = SIGNATURE + bytes(range(256)) * 1000  # longer than the buffer of a pipe


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    path = tmp_path / "scene.fcs"
    os.mkfifo(path)
    return path


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_a_named_pipe_waits_for_its_writer(pipe: Path, delay: float) -> None:
    def write() -> None:
        time.sleep(delay)
        pipe.write_bytes(DATA)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    assert read_stream_file(pipe) == DATA
    writer.join(timeout=20)


def test_a_writer_may_be_slow(pipe: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time without a writer does not run while there is one."""
    monkeypatch.setattr(stream_file, "SECONDS_WITHOUT_WRITER", 0.1)

    def write() -> None:
        with pipe.open("wb", buffering=0) as file:
            for part in (DATA[:100], DATA[100:]):
                time.sleep(0.2)
                file.write(part)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    assert read_stream_file(pipe) == DATA
    writer.join(timeout=20)


@pytest.mark.parametrize("data", [b"", DATA])
def test_a_pipeline_ends_with_its_writer(data: bytes) -> None:
    """`program | fecosplat info -`: an empty one is read at once."""
    read = "import sys; from fecocodec.container import read_stream_file as read; from pathlib import Path\n"
    read += "sys.stdout.buffer.write(read(Path('/dev/stdin')))"
    start = time.monotonic()
    result = subprocess.run([sys.executable, "-c", read], input=data, capture_output=True, check=True)
    assert result.stdout == data
    assert time.monotonic() - start < stream_file.SECONDS_WITHOUT_WRITER


def test_a_terminal_is_refused() -> None:
    master, terminal = os.openpty()
    with pytest.raises(InputError, match=r": is a terminal; give a \.fcs file, or a pipe from the program that"):
        read_stream_file(Path(os.ttyname(terminal)))
    os.close(master)
    os.close(terminal)
