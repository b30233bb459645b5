"""Read untrusted input files: regular files of bounded size; and digests of files and folders."""

import errno
import hashlib
import json
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError

StrPath = str | os.PathLike[str]
ObjectOf = Callable[[list[tuple[str, Any]]], object]

MAX_FILE_BYTES = 512 << 20
MAX_IMAGE_PIXELS = 1 << 26  # 64 megapixels; checked before an image is decoded
_CHUNK = 1 << 20  # bytes of a file that are digested at once


def require_regular_file(path: Path) -> None:
    """Check that a path is a regular file of at most MAX_FILE_BYTES, without opening it (a pipe would block).

    Raises InputError for a device, a pipe, a file that is too long, and a name that no file can have; OSError if the
    path does not exist, is a folder, or is not accessible.
    """
    try:
        found = os.stat(path)
    except ValueError as error:  # a zero byte, or half of a character
        raise InputError(f"{path}: no file can have such a name ({error}); correct the name.") from error
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: a pipe or a device cannot be read here; give a regular file.")
    if found.st_size > MAX_FILE_BYTES:
        raise InputError(
            f"{path}: the file has {found.st_size} bytes, but at most {MAX_FILE_BYTES} are read; give a smaller file."
        )


def read_file(path: Path, remedy: str = "check the path") -> bytes:
    """Return the bytes of a regular file. Raises InputError, which ends with `remedy`, if it cannot be read."""
    try:
        require_regular_file(path)
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: an invalid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); {remedy}.") from error


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file; none of what is no such file or cannot be read."""
    try:
        require_regular_file(path)  # a pipe would block
        with path.open("rb") as file:
            return file.read(count)
    except (OSError, InputError):
        return b""


def read_text(path: Path, remedy: str = "check the path") -> str:
    """Return the text of a regular UTF-8 file, without a byte order mark. Raises InputError as `read_file` does."""
    try:
        return read_file(path, remedy).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: this is not text in UTF-8; {remedy}.") from error


def read_json(path: Path, remedy: str = "export it again", object_of: ObjectOf | None = None) -> object:
    """Return the value in a JSON file. Raises InputError, with line and column, if it is not valid JSON.

    object_of: makes an object of its pairs of name and value, in their order; None for a dictionary.
    """
    text = read_text(path, remedy)
    try:
        return json.loads(text, object_pairs_hook=object_of)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}, line {error.lineno}, column {error.colno}: broken JSON ({error.msg}); {remedy}."
        ) from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits, or lists nested too deeply
        raise InputError(
            f"{path}: this JSON has a number of thousands of digits, or is nested too deeply; {remedy}."
        ) from error


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
