"""`fecosplat view`: show a .fcs file in the browser."""

import webbrowser
from pathlib import Path
from urllib.parse import quote

import click

from fecocodec.container import read_stream_file

from .options import FILE_PATH
from .output import say
from .terminal import printable

SCENE_FOLDER = "scene/"


@click.command(
    "view",
    short_help="Show a .fcs file in the browser.",
    epilog="""\b
Examples:
  fecosplat view scene.fcs
  fecosplat view scene.fcs --no-browser""",
)
@click.argument("stream", metavar="FILE.fcs", type=FILE_PATH)
@click.option(
    "--browser/--no-browser",
    "opens_browser",
    default=True,
    show_default=True,
    help="Open the page in the browser. --no-browser only prints its address.",
)
def command(stream: Path, opens_browser: bool) -> None:
    """Show FILE.fcs in a page that decodes it in the browser.

    The page is served on this machine only, on a free port, until Ctrl-C ends the command. It loads nothing from other
    hosts. Damage of the file is described in the page.
    """
    data = read_stream_file(stream)

    from fecocodec.formats.viewer_files import viewer_file, viewer_paths

    from .page_server import PageServer

    contents = {"index.html": viewer_file("index.html")}
    contents |= {path: viewer_file(path) for path in viewer_paths()}
    with PageServer(contents | {SCENE_FOLDER + stream.name: data}) as server:
        url = f"{server.url}/?file={quote(SCENE_FOLDER + stream.name, safe='')}"
        say(printable(f"{stream}: shown at {url}, Ctrl-C ends this"))
        if opens_browser:
            webbrowser.open(url)
        server.serve_forever()
