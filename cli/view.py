"""`fecosplat view`: show a .fcs file in the browser."""

import webbrowser
from pathlib import Path

import click

from fecocodec.container import read_stream_file
from fecocodec.errors import error_context

from .options import max_pixels_option, model_option, stream_path, threads_option
from .output import say
from .paths import require_model
from .progress import progress_bar
from .receivers import DecodeOptions, decode_stream
from .terminal import printable


@click.command(
    "view",
    short_help="Show a .fcs file in the browser.",
    epilog="""\b
Examples:
  fecosplat view scene.fcs
  fecosplat view scene.fcs --no-browser
  fecosplat view scene.fcs --threads 1""",
)
@click.argument("stream", metavar="FILE.fcs", type=stream_path)
@click.option(
    "--browser/--no-browser",
    "opens_browser",
    default=True,
    show_default=True,
    help="Open the page in the browser. --no-browser only prints its address.",
)
@model_option
@max_pixels_option
@threads_option
def command(stream: Path, opens_browser: bool, model: Path | None, max_pixels: int) -> None:
    """Decode FILE.fcs (- for standard input) and show the scene in a page.

    The page is that of `fecosplat decode FILE.fcs -o scene.html`; `make web` builds it once, before the installation.
    It is served on this machine only, on a free port, until Ctrl-C ends the command. It loads nothing from other hosts.
    """
    data = read_stream_file(stream)
    require_model(model)

    from fecocodec.splat_files.viewer_files import scene_page

    from .page_server import PageServer

    scene_page()  # refuses before decoding if it was not built
    with error_context(stream):
        page = _page_of(data, stream, model, max_pixels)
    with PageServer({"index.html": page}) as server:
        say(printable(f"{stream}: shown at {server.url}/, Ctrl-C ends this"))
        if opens_browser:
            webbrowser.open(server.url)
        server.serve_forever()


def _page_of(data: bytes, stream: Path, model: Path | None, max_pixels: int) -> bytes:
    """Decode a stream and return the page that shows its Gaussians."""
    from fecocodec.splat_files.gaussian_arrays import camera_arrays, gaussian_arrays
    from fecocodec.splat_files.gaussian_files import gaussian_bytes

    options = DecodeOptions("all", 1, True, False, "cpu", model, max_pixels)
    with progress_bar() as on_progress:
        decoded = decode_stream(data, options, on_progress)
    gaussians = gaussian_arrays(decoded.gaussians, str(stream))
    cameras = camera_arrays(decoded.cameras, decoded.image_size)
    return gaussian_bytes(stream.with_suffix(".html"), gaussians, cameras, 3)
