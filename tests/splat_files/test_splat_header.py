"""Files of Gaussians are counted before the viewer page gets them, and other files are one sentence."""

import base64
import gzip
import json
import struct
from pathlib import Path

import pytest

from fecocodec.errors import InputError
from fecocodec.splat_files import html_page
from fecocodec.splat_files.gaussian_files import write_gaussians
from fecocodec.splat_files.html_page import page_of_file, read_splat_header
from tests.splat_files.test_output_formats import some_gaussians

POINTS = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
)
NO_PLY = "this is no binary PLY file; give a .ply file of 3D Gaussians."
NO_SPZ = "this is no SPZ file; give an .spz file of 3D Gaussians."


def spz(*header: int) -> bytes:
    return gzip.compress(struct.pack(f"<{len(header)}I", *header), mtime=0)  # the time would be in names of tests


@pytest.mark.parametrize("name", ["a.ply", "a.compressed.ply", "a.spz"])
def test_our_files_are_counted(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    write_gaussians(path, some_gaussians(300))
    assert read_splat_header(path, path.read_bytes()) == (f".{name.rpartition('.')[2]}", 300)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", b"", NO_PLY),
        ("a.ply", POINTS, NO_PLY),
        ("a.ply", POINTS.replace(b"binary_little_endian", b"ascii") + b"end_header\n", NO_PLY),
        (
            "a.ply",
            POINTS + b"end_header\n" + bytes(12),
            "its points have no scales, rotations and opacities, so they are no Gaussians; give a .ply file of 3D "
            "Gaussians.",
        ),
        ("a.spz", b"", NO_SPZ),
        ("a.spz", b"\x1f\x8b broken", NO_SPZ),
        ("a.spz", spz(7, 3, 10), NO_SPZ),
        ("a.spz", spz(0x5053474E), NO_SPZ),
        ("a.spz", spz(0x5053474E, 3, 0), "the file holds no Gaussians; give one that does."),
        ("a.spz", b"NGSP\4\0\0\0", "the page reads SPZ up to version 3; write it again with `spz_version=3`."),
    ],
)
def test_a_file_without_gaussians_is_one_sentence(name: str, data: bytes, message: str) -> None:
    with pytest.raises(InputError) as raised:
        read_splat_header(Path(name), data)
    assert str(raised.value) == f"{name}: {message}"


def test_an_empty_ply_file_and_a_long_one_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.ply"
    write_gaussians(path, some_gaussians(0))
    with pytest.raises(InputError, match="holds no Gaussians"):
        read_splat_header(path, path.read_bytes())
    write_gaussians(path, some_gaussians(2), overwrite=True)
    monkeypatch.setattr("fecocodec.splat_files.html_page.MAX_BYTES", 1 << 8)
    with pytest.raises(InputError, match=r"the page shows files of at most \d+ MiB; compress it, as .spz."):
        read_splat_header(path, path.read_bytes())


def test_the_page_holds_the_file_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html_page, "scene_page", lambda: b"/*SCENE*/ /*GAUSSIANS*/")
    path = tmp_path / "plant.spz"
    write_gaussians(path, some_gaussians(20))
    scene, _, content = page_of_file(path, path.read_bytes()).rpartition(b" ")
    assert base64.b64decode(content) == path.read_bytes()
    fields = json.loads(scene)
    assert (fields["name"], fields["count"], fields["type"], fields["cameras"]) == ("plant", 20, "spz", None)
