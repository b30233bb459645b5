"""`fecosplat view`: show a .fcs file in the browser."""

import webbrowser
from pathlib import Path

import click

from fecocodec.container import read_stream_file
from fecocodec.errors import error_context

from .decode_options import decode_here, require_page
from .options import STREAM_PATH, max_pixels_option, model_option, threads_option
from .output import say
from .page_server import LOCAL, PageServer
from .paths import require_model
from .progress import progress_bar
from .terminal import printable


@click.command(
    "view",
    short_help="Show a .fcs file in the browser.",
    epilog="""\b
Examples:
  fecosplat view scene.fcs
  fecosplat view scene.fcs --no-browser
  fecosplat view scene.fcs --host 0.0.0.0 --port 8000""",
)
@click.argument("stream", metavar="FILE.fcs", type=STREAM_PATH)
@click.option(
    "--browser/--no-browser",
    "opens_browser",
    default=True,
    show_default=True,
    help="Open the page in the browser. --no-browser only prints its address.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page.  [default: a free one]")
@click.option(
    "--host", default=LOCAL, show_default=True, metavar="ADDRESS",
    help="Address to listen at; 0.0.0.0 shows the page to every machine that reaches this one.",
)  # fmt: skip
@model_option
@max_pixels_option
@threads_option
def command(stream: Path, opens_browser: bool, port: int, host: str, model: Path | None, max_pixels: int) -> None:
    """Decode FILE.fcs (- for standard input) and show the scene in a page.

    The page is that of `fecosplat decode FILE.fcs -o scene.html`.
    It is served until Ctrl-C ends the command, on this machine only unless --host is given. It loads nothing from other
    hosts.
    """
    data = read_stream_file(stream)
    require_model(model)

    from fecocodec.splat_files.gaussian_files import decoded_file

    require_page(".html")
    with error_context(stream), progress_bar() as on_progress:
        decoded = decode_here(data, model=model, max_pixels=max_pixels, on_progress=on_progress)
    page, _, note = decoded_file(decoded, stream.with_suffix(".html"))
    if note is not None:
        say(printable(f"note: {stream}: {note}"))
    with PageServer({"index.html": page}, host, port) as server:
        say(printable(f"{stream}: shown at {server.url}/, Ctrl-C ends this"))
        if opens_browser:
            webbrowser.open(server.url)
        server.serve_forever()
