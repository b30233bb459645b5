"""`fecosplat view`: show a .fcs file, or Gaussians, in the browser."""

import re
import webbrowser
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import click

from fecocodec.container import read_header, read_stream_file
from fecocodec.errors import OutputError, error_context

from .decode_options import decode_here, require_writer
from .options import STREAM_PATH, max_pixels_option, model_option, threads_option
from .output import say
from .paths import require_model
from .progress import progress_bar

LOCAL = "127.0.0.1"
_TYPES = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "txt": "text/plain; charset=utf-8",
    "json": "application/json",
    "wasm": "application/wasm",
}


class PageServer(ThreadingHTTPServer):
    """Serves the given contents by path, and nothing else. port: 0 for a free one.

    By default it serves programs of this machine. host: the address to listen at, for other machines.
    Raises OutputError if nobody can listen there.
    """

    daemon_threads = True

    def __init__(self, contents: Mapping[str, bytes], host: str = LOCAL, port: int = 0) -> None:
        try:
            super().__init__((host, port), _Handler)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or "no such address"
            raise OutputError(f"{host}:{port}: cannot be listened at ({reason}); change --port or --host.") from error
        self.contents = contents
        self.host = host

    @property
    def url(self) -> str:
        return f"http://{self.host}:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    server_version, sys_version = "fecosplat", ""

    def do_GET(self) -> None:
        self._answer(has_body=True)

    def do_HEAD(self) -> None:
        self._answer(has_body=False)

    def log_message(self, format: str, *args: object) -> None:
        """Keep the terminal free of a line per request."""

    def _answer(self, *, has_body: bool) -> None:
        """Answer. On this machine alone, another host name is that of a site whose name was pointed here."""
        path = unquote(urlsplit(self.path).path).removeprefix("/") or "index.html"
        content = self.server.contents.get(path)
        names = [f"{name}:{self.server.server_port}" for name in (LOCAL, "localhost")]
        if self.server.host in (LOCAL, "localhost") and self.headers.get("Host") not in names:
            return self.send_error(HTTPStatus.FORBIDDEN)
        if content is None:
            return self.send_error(HTTPStatus.NOT_FOUND)
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", _TYPES.get(path.rpartition(".")[2], "application/octet-stream"))
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-cache")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        if has_body:
            self.wfile.write(content)


OF_GAUSSIANS = (".ply", ".spz")


@click.command(
    "view",
    short_help="Show a .fcs file, or Gaussians, in the browser.",
    epilog="""\b
Examples:
  fecosplat view scene.fcs
  fecosplat view scene.ply
  fecosplat view scene.fcs --no-browser
  fecosplat view scene.fcs --decode-in-browser
  fecosplat view scene.fcs --host 0.0.0.0 --port 8000""",
)
@click.argument("scene", metavar="FILE", type=STREAM_PATH)
@click.option(
    "--browser/--no-browser",
    "opens_browser",
    default=True,
    help="Open the page in the browser. --no-browser only prints its address.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=False,
    help="Port of the page.  [default: a free one]",
)
@click.option(
    "--host", default=LOCAL, metavar="ADDRESS",
    help="Address to listen at; 0.0.0.0 shows the page to every machine that reaches this one.",
)  # fmt: skip
@click.option(
    "--decode-in-browser",
    "decodes_there",
    is_flag=True,
    help="Send the .fcs file and the page of `fecosplat web`, which decodes it, instead of decoded Gaussians.",
)
@model_option
@max_pixels_option
@threads_option
def command(
    scene: Path,
    opens_browser: bool,
    port: int,
    host: str,
    decodes_there: bool,
    model: Path | None,
    max_pixels: int,
) -> None:
    """Show FILE in a page: a .fcs file (- for standard input), which is decoded, or a .ply or .spz file of Gaussians.

    The page of a .fcs file is that of `fecosplat decode FILE.fcs -o scene.html`.
    It is served until Ctrl-C ends the command, on this machine only unless --host is given. It loads nothing from other
    hosts.
    """
    if decodes_there:
        contents, query = _decoding_page(scene, model)
    else:
        contents, query = {"index.html": _page(scene, model, max_pixels)}, ""
    with PageServer(contents, host, port) as server:
        address = f"{server.url}/{query}"
        say(f"{scene}: shown at {address} (Ctrl-C ends this)")
        if opens_browser:
            webbrowser.open(address)
        server.serve_forever()


def _page(scene: Path, model: Path | None, max_pixels: int) -> bytes:
    """Return the page that holds the Gaussians of a file."""
    if scene.suffix.lower() in OF_GAUSSIANS:
        from fecocodec.input_file import read_file
        from fecocodec.splat_files.html_page import page_of_file

        return page_of_file(scene, read_file(scene))

    data = read_stream_file(scene)
    require_model(model)

    from fecocodec.splat_files.gaussian_files import decoded_file

    require_writer(Path("scene.html"))
    with error_context(scene), progress_bar() as on_progress:
        decoded = decode_here(data, model=model, max_pixels=max_pixels, on_progress=on_progress)
    page, _, note = decoded_file(decoded, scene.with_suffix(".html"))
    if note is not None:
        say(f"note: {scene}: {note}")
    return page


def _decoding_page(scene: Path, model: Path | None) -> tuple[dict[str, bytes], str]:
    """Return the files of the page that decodes, with the .fcs file, and the query that makes it open this file."""
    if scene.suffix.lower() in OF_GAUSSIANS or model is not None:
        raise click.UsageError("--decode-in-browser sends a .fcs file, and decodes it with a model that ships.")
    data = read_stream_file(scene)
    with error_context(scene):
        read_header(data)

    from fecocodec.splat_files.html_page import decoding_page

    name = re.sub(r"[?#%\\]", "_", scene.name)  # which have a meaning in addresses
    return {name: data, **decoding_page()}, f"?file={quote(name)}"
