"""The page that shows decoded Gaussians, which `make web` builds from `web/` into the package."""

from pathlib import Path

from fecocodec.errors import OutputError

FOLDER = Path(__file__).parents[1] / "web"
SCENE_PAGE = "scene.html"


def scene_page(folder: Path = FOLDER) -> bytes:
    """Return the page without a scene. Raises OutputError if it was not built."""
    path = folder / SCENE_PAGE
    try:
        return path.read_bytes()
    except OSError as error:
        raise OutputError(
            f"{path}: the viewer page was not built ({error.strerror}); run `make web` in the repository "
            "(it needs Node.js), then install again."
        ) from error
