"""Reading a .fcs file from disk."""

from pathlib import Path

from fecocodec.errors import InputError


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
