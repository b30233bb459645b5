"""Reading a .fcs file from disk, and naming it in what goes wrong with it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fecocodec.errors import BitstreamError, InputError, ModelError


def read_bytes(path: Path) -> bytes:
    """The whole file; raises InputError where there is none or it cannot be read."""
    try:
        return path.read_bytes()
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder; give a .fcs file.") from error
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; check the path.") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions.") from error


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before an error about its bytes; the library was given bytes and does not know it."""
    try:
        yield
    except (BitstreamError, ModelError) as error:
        raise type(error)(f"{path}: {error}") from error
