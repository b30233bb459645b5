"""Streams that `decode` and `render` refuse: one sentence that names the file, and nothing left behind."""

import gzip
import os
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from refusals import assert_refused

from tests.example_scenes import MODEL


def with_new_crc(header: bytes) -> bytes:
    """A two-stage header whose CRC fits again after a change."""
    return header[:-4] + zlib.crc32(header[:-4]).to_bytes(4, "little")


def of_version(data: bytes, major: int) -> bytes:
    return with_new_crc(data[:8] + bytes([major]) + data[9:48]) + data[48:]


def of_model(data: bytes, model_id: bytes) -> bytes:
    return with_new_crc(data[:10] + model_id + data[18:48]) + data[48:]


def with_flipped_bit(data: bytes, byte: int) -> bytes:
    return data[:byte] + bytes([data[byte] ^ 4]) + data[byte + 1 :]


def with_another_digest(data: bytes) -> bytes:
    return with_new_crc(data[:28] + bytes(8) + data[36:48]) + data[48:]


BAD_STREAMS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "not an .fcs": (
        lambda data: b"\x89PNG\r\n\x1a\n" + bytes(100),
        "not a .fcs file: its signature at byte 0 is 89 50 4e 47 0d 0a 1a 0a instead of 89 46 43 53 0d 0a 1a 0a; give "
        "a file written by fecosplat encode.",
    ),
    "newer version": (
        lambda data: of_version(data, 3),
        "header at byte 8: format version 3.0 is newer than 2.x, which this program reads; install a newer fecosplat.",
    ),
    "cut in the second stage": (lambda data: data[:-1], "section B2 at byte ..."),
    "corrupted cameras": (lambda data: with_flipped_bit(data, 60), "section cameras at byte 48: CRC-32 is ..."),
    "joined with another": (lambda data: data + data, "end at byte ..."),
    "unknown model": (
        lambda data: of_model(data, b"no model"),
        f"the stream needs the receiver weights with model id {b'no model'.hex()}, but {{weights}} has {MODEL}; "
        "install the version of the package that made the file, or name the folder of its model.",
    ),
    "symbols other than the header says": (with_another_digest, "stage 1: the decoded symbols have digest ..."),
}


@pytest.mark.parametrize("command", ["decode", "render"])
@pytest.mark.parametrize(("damage", "sentence"), BAD_STREAMS.values(), ids=BAD_STREAMS)
def test_bad_streams(fecosplat, wall_file, random_weights, output, damage, sentence, command) -> None:
    wall_file.write_bytes(damage(wall_file.read_bytes()))
    result = fecosplat(command, wall_file, "-o", output / "result.ply" if command == "decode" else output)
    assert_refused(result, output, f"{wall_file}: {sentence.format(weights=random_weights)}")


@pytest.mark.parametrize("command", ["decode", "info"])
def test_a_file_longer_than_any_stream_is_not_read(fecosplat, wall_file: Path, output: Path, command: str) -> None:
    os.truncate(wall_file, 1 << 40)  # takes no room on the disk
    result = fecosplat(command, wall_file, *(("-o", output / "a.ply") if command == "decode" else ()))
    assert_refused(result, output, f"{wall_file}: it is longer than the 1073741824 bytes that a .fcs file can ...")


def test_an_endless_device_is_refused_by_its_beginning(fecosplat, output: Path) -> None:
    result = fecosplat("decode", "/dev/zero", "-o", output / "a.ply")
    assert_refused(result, output, "/dev/zero: not a .fcs file: its signature at byte 0 is 00 00 00 00 00 00 00 00...")


OF_GAUSSIANS = "; of Gaussians, fecosplat view reads .ply and .spz files"


@pytest.mark.parametrize(
    ("start", "kind", "readers"),
    [
        (b"ply\nformat ascii 1.0", "a .ply file", "; fecosplat view and fecosplat render read .ply files"),
        (b"NGSP\4\0\0\0", "an .spz file", "; fecosplat view reads .spz files"),
        (
            gzip.compress(b"NGSP", mtime=0),
            "an .spz file, or another one compressed with gzip",
            "; fecosplat view reads .spz files",
        ),
        (b"glTF\2\0\0\0", "a .glb file", OF_GAUSSIANS),
        (b"PK\3\4\0\0\0\0", "a .sog file, or another ZIP archive", OF_GAUSSIANS),
        (b"<!DOCTYPE html>", "a page (HTML)", ""),
        (b"\xff\xd8\xff\xe0\0\x10JF", "a JPEG image", "; it reads folders of photographs"),
    ],
)
def test_a_known_format_is_named(fecosplat, tmp_path, output, start, kind, readers) -> None:
    file = tmp_path / "scene.ply"
    file.write_bytes(start)
    sentence = f"{file}: not a .fcs file: this is {kind}; give a file written by fecosplat encode{readers}."
    for options in (("-o", output / "a.ply"), ()):  # the default output is the input, which exists
        assert_refused(fecosplat("decode", file, *options), output, sentence)
