"""The built files of the viewer page (`web/`), which `make web` writes into the package."""

from collections.abc import Iterator
from pathlib import Path

from fecocodec.errors import OutputError

FOLDER = Path(__file__).parents[1] / "web"


def viewer_file(name: str, folder: Path = FOLDER) -> bytes:
    """Return a built file. Raises OutputError if the page was not built."""
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise OutputError(
            f"{folder / name}: the viewer page was not built ({error.strerror}); run `make web` in the repository "
            "(it needs Node.js), then install again."
        ) from error


def viewer_paths(folder: Path = FOLDER) -> Iterator[str]:
    """Yield the relative paths of all built files, with forward slashes."""
    return (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
