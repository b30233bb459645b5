"""A web server on this machine for the viewer page and one file."""

from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

from fecocodec.errors import OutputError

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
            raise OutputError(f"{host}:{port}: cannot be listened at ({reason}); choose another one.") from error
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
