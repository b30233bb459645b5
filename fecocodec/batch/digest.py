"""SHA-256 of the input of a scene: a file, or all files of a folder."""

import hashlib
import os
from pathlib import Path

from fecocodec.errors import InputError

_CHUNK = 1 << 20


def input_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and contents of all files below a folder, in hexadecimal.

    Hidden files and folders are left out. Raises InputError if a file cannot be read.
    """
    try:
        return _folder_digest(path) if path.is_dir() else file_digest(path)
    except (OSError, ValueError) as error:
        place = getattr(error, "filename", None) or path
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{place}: cannot be read ({reason}); check the path and its permissions.") from error


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal. Raises OSError if it cannot be read."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def _folder_digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for parent, folders, files in os.walk(folder, onerror=_raise, followlinks=True):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(parent, name)
            if not name.startswith(".") and path.is_file():
                relative = path.relative_to(folder).as_posix().encode("utf-8", "surrogateescape")
                digest.update(len(relative).to_bytes(4, "big") + relative + bytes.fromhex(file_digest(path)))
    return digest.hexdigest()


def _raise(error: OSError) -> None:
    raise error
