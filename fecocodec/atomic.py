"""Write output files completely or not at all; temporary folders."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from fecocodec.errors import OutputError

# Errors of os.link on file systems without hard links.
_NO_LINKS = (errno.EPERM, errno.EACCES, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)


def make_folder(folder: Path) -> None:
    """Create a folder and its parents. Raises OutputError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: the folder cannot be made ({error.strerror}); choose another output path."
        ) from error


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Create a folder and its missing parents; remove the created ones if the block raises. Raises OutputError."""
    missing = [path for path in (folder, *folder.parents) if not os.path.lexists(path)]
    try:
        make_folder(folder)
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):  # it was not created, or is no longer empty
                path.rmdir()
        raise


def require_writable(path: Path, *, overwrite: bool) -> None:
    """Check an output path before any work is done. Its folder may be missing, as writing creates it.

    Raises OutputError if the folder cannot be one or takes no new file, the path cannot be a regular file, or it exists
    and `overwrite` is false.
    """
    _require_file_path(path, overwrite=overwrite)
    folder = _nearest_existing(path.resolve())  # through a symbolic link, as `write_atomically` does
    trial = folder / f".{secrets.token_urlsafe(9)}.part"  # permissions alone do not tell
    try:
        trial.touch(exist_ok=False)
    except OSError as error:
        raise OutputError(
            f"{path}: no file can be made in {folder} ({error.strerror}); choose another output path."
        ) from error
    finally:  # also after a signal between the making of the file and the end of the call
        with suppress(OSError):
            trial.unlink(missing_ok=True)


def _require_file_path(path: Path, *, overwrite: bool) -> None:
    """Raise OutputError as `require_writable` does, but without trying whether the folder takes a new file."""
    folder = path.parent if not _is_missing(path.parent) else _nearest_existing(path)
    if not os.path.isdir(folder):
        raise OutputError(f"{path}: {folder} is not a folder; choose another output path.")
    if _is_missing(path):
        return
    if os.path.isdir(path):
        raise OutputError(f"{path}: this is a folder; give the name of a file, such as {path / 'NAME'}.")
    if not os.path.isfile(path):
        raise OutputError(f"{path}: this exists and is not a plain file; choose another output path.")
    if not overwrite:
        raise OutputError(_exists(path))


def _is_missing(path: Path) -> bool:
    """Return whether a path does not exist. Raises OutputError if that is unknown (name too long, no access)."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); choose another output path.") from error
    return False


def _nearest_existing(path: Path) -> Path:
    """Return the nearest of the parents that exists; a symbolic link to nothing does."""
    return next(parent for parent in path.absolute().parents if os.path.lexists(parent))


def _exists(path: Path) -> str:
    return f"{path}: the file exists already; choose another output path or replace it by `overwrite`."


def require_other_file(output: Path, source: Path) -> None:
    """Check that writing `output` does not replace the input.

    Raises OutputError if both are the same file, or if `source` is a folder and `output` an existing file in it, such
    as a photograph; existing `.fcs` files may be replaced.
    """
    if not os.path.exists(output) or not os.path.exists(source):
        return
    is_inside = source.is_dir() and source.resolve() in output.resolve().parents and output.suffix != ".fcs"
    if is_inside or output.samefile(source):
        raise OutputError(f"{output}: this is the input, or part of it; choose another output path.")


@contextmanager
def write_atomically(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary path beside `path`; the file written there is renamed to `path` when the block ends.

    Missing folders are created. The temporary name keeps the suffix of `path`, because image libraries select the
    format by it. If the block fails, the temporary file and the created folders are removed, and `path` does not
    change. Without `overwrite`, a file that was created at `path` in the meantime is kept.
    Raises OutputError as `require_writable` does, and if writing fails (disk full, no permission).
    """
    _require_file_path(path, overwrite=overwrite)
    with made_folder(path.parent):
        target = path.resolve()  # through a symbolic link, so that the link survives
        temporary = target.with_name(f".{secrets.token_hex(6)}.part{target.suffix}")
        try:
            yield temporary
            if overwrite:
                os.replace(temporary, target)
            else:
                _rename_to_new(temporary, target)
        except FileExistsError as error:
            raise OutputError(_exists(path)) from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                f"{path}: writing failed ({reason}); check free space and permissions or choose another output path."
            ) from error
        finally:
            with suppress(OSError):  # a read-only disk refuses even this; the error above is the one to report
                temporary.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes, *, overwrite: bool) -> None:
    """Write bytes, or text in UTF-8; as `write_atomically` does."""
    with write_atomically(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def _rename_to_new(temporary: Path, target: Path) -> None:
    """Rename without replacing an existing file, unlike `os.rename`. Raises FileExistsError if there is one."""
    try:
        os.link(temporary, target)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target)) from error
        os.replace(temporary, target)


@contextmanager
def write_folder_atomically(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `folder`, which is renamed to `folder` when the block ends, or else removed.

    Raises OutputError if the folder exists and is not empty, or cannot be made.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise OutputError(f"{folder}: this exists and is no empty folder; choose another output path.")
    with made_folder(folder.parent):
        temporary = folder.with_name(f".{secrets.token_hex(6)}.part")
        try:
            make_folder(temporary)
            yield temporary
            with suppress(FileNotFoundError):
                folder.rmdir()
            temporary.rename(folder)
        except OSError as error:
            raise OutputError(f"{folder}: writing failed ({error.strerror}); choose another output path.") from error
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a folder that is removed when the block ends. Raises OutputError if its disk is full."""
    with TemporaryDirectory(prefix="fecosplat-") as folder:
        try:
            yield Path(folder)
        except OSError as error:
            if not is_disk_full(error):
                raise
            raise _full(Path(folder)) from error


def is_disk_full(error: Exception) -> bool:
    """Return whether the system refused a write for want of space."""
    return isinstance(error, OSError) and error.errno in _DISK_FULL


def require_space(folder: Path, num_bytes: int) -> None:
    """Raise OutputError if the disk of a temporary folder has less space; a library aborts the process there."""
    if shutil.disk_usage(folder).free < num_bytes:
        raise _full(folder, f", as {num_bytes / 2**20:.0f} MiB are needed")


def _full(folder: Path, needed: str = "") -> OutputError:
    return OutputError(
        f"{folder.parent}: the disk of the temporary folder is full{needed}; free space, or set TMPDIR to another one."
    )
