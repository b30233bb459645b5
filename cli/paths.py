"""Checks of paths that need no large library, so that a wrong path is reported at once."""

import os
import re
from pathlib import Path

from fecocodec.errors import InputError, OutputError

STDOUT = Path("-")
_IS_EXTENSION = re.compile(r"\.[A-Za-z]{2,5}")  # of a file format; `.v2` and `.1` are parts of a name


def require_ending(output: Path, endings: tuple[str, ...]) -> None:
    """Refuse the ending of a format that is not written here, and `-` for stdout; a name without ending is accepted.

    Raises OutputError.
    """
    suffix = output.suffix.lower()
    if output == STDOUT:
        raise OutputError("-: the result is not written to standard output; give the name of a file.")
    if _IS_EXTENSION.fullmatch(suffix) and suffix not in endings:
        raise OutputError(f"{output}: files of kind {suffix} are not written here; use {' or '.join(endings)}.")


def require_photographs(folder: Path) -> None:
    """Refuse a folder of photographs that does not exist, in the library's words. Raises InputError."""
    require_input(folder, "no such folder; give the folder that holds images and cameras.")


def require_input(path: Path, missing: str = "there is no such file; check the path.") -> None:
    """Refuse an input that does not exist. missing: the end of the sentence for it. Raises InputError."""
    try:
        os.stat(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: {missing}") from error
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the path and its permissions.") from error
