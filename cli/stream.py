"""Reading a .fcs file from disk."""

import os
from pathlib import Path

from fecocodec.container import MAX_STREAM_BYTES, SIGNATURE
from fecocodec.errors import InputError

_CHUNK = 1 << 20


def read_bytes(path: Path) -> bytes:
    """The whole file, or what a pipe gives; of what is no stream, only the beginning.

    Raises InputError where there is none, it cannot be read, or it is longer than any stream.
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
    """In chunks, because a pipe or a device does not say how long it is.

    No further than the first where that is not the beginning of a stream: whoever parses it says what it is instead.
    """
    with path.open("rb") as file:
        data = bytearray(file.read(_CHUNK))
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
