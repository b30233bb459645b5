"""`fecosplat view` serves the page and one file, and nothing else."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread

import pytest

from cli.view import PageServer
from fecocodec.errors import OutputError
from tests.vectors.tiny_model import VECTORS

CONTENTS = {"index.html": b"<html>", "scene/a b.fcs": b"\x89FCS"}


@contextmanager
def serving(*host: str) -> Iterator[PageServer]:
    with PageServer(CONTENTS, *host) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def get(port: int, path: str, host: str | None = None) -> tuple[int, bytes]:
    connection = HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    response = connection.getresponse()
    return response.status, response.read()


@pytest.mark.parametrize("path", ["/", "/?file=x", "/index.html", "/scene/a%20b.fcs"])
def test_the_page_and_the_file_are_served(path: str) -> None:
    with serving() as server:
        assert get(server.server_port, path) == (200, b"\x89FCS" if path.startswith("/scene") else b"<html>")


@pytest.mark.parametrize(
    "path", ["/scene/", "/other.fcs", "/../pyproject.toml", "/%2e%2e/pyproject.toml", "//etc/passwd"]
)
def test_nothing_else_is_served(path: str) -> None:
    with serving() as server:
        assert get(server.server_port, path)[0] == 404


def test_other_host_names_are_served_where_the_host_says_so() -> None:
    with serving() as server:
        assert get(server.server_port, "/", host="example.org")[0] == 403
        assert get(server.server_port, "/", host=f"localhost:{server.server_port}")[0] == 200
    with serving("0.0.0.0") as server:
        assert server.url == f"http://0.0.0.0:{server.server_port}"
        assert get(server.server_port, "/", host="scenes.example.org")[0] == 200


@pytest.mark.parametrize("host", ["127.0.0.1", "no.such.host.invalid"])
def test_an_address_that_cannot_be_listened_at_is_one_sentence(host: str) -> None:
    with PageServer(CONTENTS) as server, pytest.raises(OutputError, match=f"^{host}:.* cannot be listened at"):
        PageServer(CONTENTS, host, server.server_port)


def test_the_command_serves_until_it_is_interrupted(tmp_path: Path) -> None:
    path = tmp_path / "näme 1.fcs"
    path.write_bytes((VECTORS / "valid/scene-compact-6.fcs").read_bytes())
    command = [sys.executable, "-m", "fecosplat_cli", "view", str(path), "--no-browser"]
    # Whoever runs the tests in the background has the signal ignored, and children inherit that.
    heed = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heed) as process:
        try:
            assert process.stderr is not None
            line = process.stderr.readline()
            found = re.search(r"http://127\.0\.0\.1:(\d+)/ ", line)
            assert found, line
            status, page = get(int(found[1]), "/")
            assert status == 200
            scene = re.search(rb'<script type="application/json" id="scene">(.*?)</script>', page)
            assert scene, page[:1000]
            content = json.loads(scene[1])
            assert content["name"] == "näme 1"
            assert len(content["cameras"]["views"]) == 2
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 130
            assert process.stderr.read() == "fecosplat: interrupted\n"
        finally:
            process.kill()
