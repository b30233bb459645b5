"""The page that decodes `.fcs` files in the browser: its files, which any web server can send. No NumPy."""

from pathlib import Path

from fecocodec.errors import OutputError

FOLDER = Path(__file__).parents[1] / "web"
START = "index.html"
_OTHER_PAGE = "scene.html"  # shows one decoded scene


def decoding_page(folder: Path = FOLDER) -> dict[str, bytes]:
    """Return the contents of the page's files by their path in its folder. Raises OutputError if it was not built."""
    if not (folder / START).is_file():
        raise OutputError(
            f"{folder / START}: the page that decodes in the browser was not built; run `make web` in the clone (needs "
            "Node.js 20)."
        )
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != _OTHER_PAGE)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
