"""Read the bytes of a `.fcs` file with bounded memory."""

import os
from pathlib import Path

from fecocodec.container.header_bytes import SIGNATURE
from fecocodec.container.stream import MAX_STREAM_BYTES
from fecocodec.errors import InputError

_CHUNK = 1 << 20


def read_stream_file(path: Path) -> bytes:
    """Return the bytes of a file or pipe, or only the first MiB if it does not start with the signature.

    Raises InputError if the file is missing, cannot be read, or is longer than any valid stream.
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
