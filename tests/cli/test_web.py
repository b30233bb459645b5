"""`fecosplat web` and `view --decode-in-browser` hand out the page that decodes; `view` takes files of Gaussians."""

from collections.abc import Iterator
from functools import partial
from http.client import HTTPConnection
from http.server import ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import quote

import pytest
from fecosplat_cli import view
from fecosplat_cli.view import PageServer

from fecocodec.splat_files import html_page
from fecocodec.splat_files.gaussian_files import write_gaussians
from tests.splat_files.test_output_formats import some_gaussians
from tests.vectors.tiny_model import VECTORS

PAGE = {"index.html": b"<html>", "ort.wasm": b"\0asm", "models/ed2e/receiver.safetensors": b"weights"}


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a page as `make web` builds it."""
    folder = tmp_path / "built"
    for name, content in {**PAGE, "scene.html": b"the other page"}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    monkeypatch.setattr(html_page, "decoding_page", partial(html_page.decoding_page, folder))
    return folder


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, tuple[int, bytes]]]:
    """Let `view` answer one request for each file of its page, and return the answers by path, then end."""
    answers: dict[str, tuple[int, bytes]] = {}

    def ask(self: PageServer) -> None:
        thread = Thread(target=ThreadingHTTPServer.serve_forever, args=(self,))
        thread.start()
        try:
            for path in (*self.contents, "absent"):
                connection = HTTPConnection("127.0.0.1", self.server_port, timeout=10)
                connection.request("GET", f"/{quote(path)}")
                response = connection.getresponse()
                answers[path] = (response.status, response.read())
        finally:
            self.shutdown()
            thread.join()

    monkeypatch.setattr(PageServer, "serve_forever", ask)
    monkeypatch.setattr(view.webbrowser, "open", lambda address: answers.__setitem__("address", address))
    return answers


@pytest.mark.usefixtures("built")
def test_the_page_is_written_to_a_new_folder(fecosplat, tmp_path: Path) -> None:
    site = tmp_path / "site"
    result = fecosplat("web", site)
    assert (result.code, result.err) == (
        0,
        f"{site}: 3 files, 0.0 MB; put .fcs files into it, and open ?file=NAME.fcs\n",
    )
    written = {path.relative_to(site).as_posix(): path.read_bytes() for path in site.rglob("*") if path.is_file()}
    assert written == PAGE
    assert fecosplat("web", site).err == (
        f"fecosplat: {site}: this exists and is no empty folder; choose another output path.\n"
    )


@pytest.mark.parametrize(
    "arguments", [("web", "site"), ("view", VECTORS / "valid/scene-compact-6.fcs", "--decode-in-browser")]
)
def test_a_page_that_was_not_built_is_one_sentence(fecosplat, built, arguments, tmp_path) -> None:
    (built / "index.html").unlink()
    result = fecosplat(*arguments)
    assert (result.code, result.err) == (
        1,
        f"fecosplat: {built / 'index.html'}: the page that decodes in the browser was not built; run `make web` in the "
        "clone (needs Node.js 20), and install it again.\n",
    )
    assert not (tmp_path / "site").exists()


@pytest.mark.usefixtures("built")
def test_the_file_and_the_page_that_decodes_it_are_served(fecosplat, opened, tmp_path: Path) -> None:
    scene = tmp_path / "a b?.fcs"
    scene.write_bytes((VECTORS / "valid/scene-compact-6.fcs").read_bytes())
    assert fecosplat("view", scene, "--decode-in-browser").code == 0
    address = opened.pop("address")
    assert address.startswith("http://127.0.0.1:") and address.endswith("/?file=a%20b_.fcs")
    assert opened.pop("absent")[0] == 404
    assert {path: body for path, (status, body) in opened.items() if status == 200} == {
        **PAGE,
        "a b_.fcs": scene.read_bytes(),
    }


def test_gaussians_of_a_file_are_shown(fecosplat, opened, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html_page, "scene_page", lambda: b"/*SCENE*/ /*GAUSSIANS*/")
    scene = tmp_path / "plant.ply"
    write_gaussians(scene, some_gaussians(20))
    assert fecosplat("view", scene).code == 0
    status, page = opened["index.html"]
    assert status == 200 and b'"name": "plant", "count": 20, "type": "ply"' in page


def test_a_damaged_file_is_not_served(fecosplat, tmp_path: Path) -> None:
    scene = tmp_path / "a.fcs"
    scene.write_bytes(b"\x89FCS")
    result = fecosplat("view", scene, "--decode-in-browser")
    assert result.code == 1 and result.err.startswith(f"fecosplat: {scene}: ") and result.err.count("\n") == 1
