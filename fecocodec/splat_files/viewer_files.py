"""The page that shows decoded Gaussians, which `make web` builds from `web/` into the package."""

from pathlib import Path

from fecocodec.errors import OutputError

FOLDER = Path(__file__).parents[1] / "web"
SCENE_PAGE = "scene.html"


def scene_page(folder: Path = FOLDER) -> bytes:
    """Return the page without a scene. Raises OutputError if it was not built."""
    try:
        return (folder / SCENE_PAGE).read_bytes()
    except OSError as error:
        raise OutputError(
            "the viewer page was not built; run `make web` in the clone (needs Node.js 20), then `pip install` again "
            "unless the installation is editable."
        ) from error
