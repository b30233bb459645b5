"""Read the bytes of a `.fcs` file with bounded memory."""

import os
import time
from pathlib import Path

from fecocodec.container.header_bytes import SIGNATURE
from fecocodec.container.stream import MAX_STREAM_BYTES
from fecocodec.errors import InputError

SECONDS_WITHOUT_WRITER = 10.0  # then a named pipe is given up
_CHUNK = 1 << 20
_SECONDS_BETWEEN_LOOKS = 0.02


def read_stream_file(path: Path) -> bytes:
    """Return the bytes of a file or pipe, or only the first MiB if it does not start with the signature.

    A named pipe is given up if no program writes to it within SECONDS_WITHOUT_WRITER. From then on its writer may take
    as long as it needs.
    Raises InputError if the file is missing, cannot be read, is a terminal, or is longer than any valid stream.
    """
    try:
        return _read_bounded(path)
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder; give a .fcs file.") from error
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; check the path.") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions.") from error


def _read_bounded(path: Path) -> bytes:
    """Read in chunks, because the length of a pipe or a device is not known beforehand.

    A file with another signature is cut after the first chunk; the stream parser then reports the wrong signature.
    """
    is_named_pipe = Path(os.path.realpath(path)).is_fifo()  # not /dev/stdin of a pipeline: its path has no file
    at_once = os.O_NONBLOCK if is_named_pipe else 0  # so that opening does not wait for a writer
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | at_once)) as file:
        if file.isatty():
            raise InputError(f"{path}: is a terminal; give a .fcs file, or a pipe from the program that writes one.")
        data = bytearray(_first_bytes(file.fileno(), path) if is_named_pipe else b"")
        data += file.read(_CHUNK - len(data))
        if not data.startswith(SIGNATURE):
            return bytes(data)
        if os.fstat(file.fileno()).st_size <= MAX_STREAM_BYTES:
            while len(data) <= MAX_STREAM_BYTES and (chunk := file.read(_CHUNK)):
                data += chunk
            if len(data) <= MAX_STREAM_BYTES:
                return bytes(data)
    raise InputError(
        f"{path}: it is longer than the {MAX_STREAM_BYTES} bytes that a .fcs file can have; give the file as it was "
        "written by fecosplat encode."
    )


def _first_bytes(pipe: int, path: Path) -> bytes:
    """Wait for a writer of a pipe that is open without one; return what it has written. Later reads wait, too."""
    end = time.monotonic() + SECONDS_WITHOUT_WRITER
    first = b""
    while not first:
        try:
            first = os.read(pipe, _CHUNK)
        except BlockingIOError:  # there is a writer, which has not written yet
            break
        if not first and time.monotonic() >= end:
            raise InputError(
                f"{path}: no program wrote to this pipe within {SECONDS_WITHOUT_WRITER:g} seconds; start the "
                "program that writes to it, or give a file."
            )
        if not first:
            time.sleep(_SECONDS_BETWEEN_LOOKS)
    os.set_blocking(pipe, True)
    return first
