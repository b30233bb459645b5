"""Path checks that need no large library, so that a wrong path is reported immediately."""

import os
import re
from pathlib import Path

from fecocodec.container.header_bytes import SIGNATURE_BYTES, check_signature
from fecocodec.errors import InputError, OutputError, error_context
from fecocodec.input_file import first_bytes
from fecocodec.model_files import RECEIVER_FILE, SENDER_FILE

STDOUT = Path("-")
# A file format; `.v2`, `.1` and `.renders` are parts of a name.
_IS_EXTENSION = re.compile(r"\.([a-z]{2,5}|ksplat|splatv|geojson|\d[a-z]{1,2}|[a-z]\d[a-z]|h5|mp4|e57)")


def require_ending(output: Path, endings: tuple[str, ...]) -> None:
    """Raise OutputError for `-` (stdout), or an extension that is none of `endings`; a name may have none."""
    suffix = output.suffix.lower()
    if output == STDOUT:
        raise OutputError("-: the result is not written to standard output; give the name of a file.")
    if _IS_EXTENSION.fullmatch(suffix) and suffix not in endings:
        raise OutputError(f"{output}: files of kind {suffix} are not written here; use {' or '.join(endings)}.")


def require_output_folder(folder: Path) -> None:
    """Raise OutputError if the path of an output folder is that of a file, or leads through a file."""
    existing = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not existing.is_dir():
        where = "this" if existing == folder else str(existing)
        raise OutputError(f"{folder}: {where} is not a folder; choose another output path.")


def require_new_model(folder: Path) -> None:
    """Raise OutputError if a model cannot be written to a folder, or if one is there: files need its receiver."""
    require_output_folder(folder)
    if any((folder / name).exists() for name in (RECEIVER_FILE, SENDER_FILE)):
        raise OutputError(
            f"{folder}: this folder holds a model already; choose another output path, or delete what an interrupted "
            "export left."
        )


def require_photographs(folder: Path) -> None:
    """Raise InputError if a folder of photographs, or a video, does not exist."""
    kind = "file" if _IS_EXTENSION.fullmatch(folder.suffix.lower()) else "folder"
    require_input(folder, f"no such {kind}; check the path.")


def require_model(folder: Path | None) -> None:
    """Raise InputError if the folder of --model does not exist; None is the shipped model."""
    if folder is not None:
        require_input(folder, "there is no such folder; name the folder of a model.")


def require_stream(path: Path) -> None:
    """Raise BitstreamError if a regular file begins as no `.fcs` file does. Pipes are left for the reader."""
    if start := first_bytes(path, SIGNATURE_BYTES):
        with error_context(path):
            check_signature(start)


def require_input(path: Path, missing: str = "there is no such file; check the path.") -> None:
    """Raise InputError if an input does not exist or cannot be read. missing: message for one that does not exist."""
    try:
        os.stat(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: {missing}") from error
    except (OSError, ValueError) as error:  # ValueError: not a valid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the path and its permissions.") from error
