"""Output files appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fecocodec.errors import OutputError


def make_folder(folder: Path) -> None:
    """Raises OutputError where there is no folder and none can be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: the folder cannot be made ({error.strerror}); choose another output path."
        ) from error


def require_writable(path: Path, *, overwrite: bool) -> None:
    """Refuse an output path before any work is spent on it.

    Raises OutputError where the folder is missing, where the path is not a plain file, or where it exists and
    `overwrite` is false.
    """
    if not os.path.isdir(path.parent):  # unlike Path.is_dir, False where permission is missing
        raise OutputError(f"{path}: the folder {path.parent} does not exist; create it or choose another output path.")
    if os.path.exists(path) and not os.path.isfile(path):
        raise OutputError(f"{path}: this exists and is not a plain file; choose another output path.")
    if os.path.exists(path) and not overwrite:
        raise OutputError(f"{path}: the file exists already; choose another output path or replace it by --overwrite.")


def require_other_file(output: Path, source: Path) -> None:
    """Refuse to replace what is being read, whatever names lead to it.

    Raises OutputError where both are the same file, or where `source` is a folder and `output` a file that is in it
    already and no `.fcs`: a photograph or its cameras.
    """
    if not output.exists() or not source.exists():
        return
    is_inside = source.is_dir() and source.resolve() in output.resolve().parents and output.suffix != ".fcs"
    if is_inside or output.samefile(source):
        raise OutputError(f"{output}: this is the input, or part of it; choose another output path.")


@contextmanager
def write_atomically(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary path beside `path`; what was written there takes the name `path` when the block ends.

    The temporary name keeps the suffix of `path`, because image libraries choose the format by it. Whatever goes wrong
    in the block, the temporary file is removed and `path` stays as it was.
    Raises OutputError as `require_writable` does, and where the system refuses to write (disk full, no permission).
    """
    require_writable(path, overwrite=overwrite)
    target = path.resolve()  # through a symbolic link, so that the link survives
    temporary = target.with_name(f".{secrets.token_hex(6)}.part{target.suffix}")
    try:
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"{path}: writing failed ({reason}); check free space and permissions or choose another output path."
        ) from error
    finally:
        with suppress(OSError):  # a read-only disk refuses even this; why writing failed is what counts
            temporary.unlink(missing_ok=True)
