"""`fecosplat info`."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fecocodec.container import read_stream, with_metadata, write_stream
from fecocodec.container import stream_file as stream_file_module

CONSOLE_SCRIPT = Path(sys.executable).with_name("fecosplat")


def test_json_describes_the_stream(fecosplat, stream_file: Path, stream_bytes: bytes) -> None:
    result = fecosplat("info", stream_file, "--json")
    fields = json.loads(result.out)
    assert result.code == 0 and result.err == ""
    assert (fields["views"], fields["height"], fields["width"], fields["stages"]) == (2, 256, 448, 2)
    assert fields["lambda"] == pytest.approx(1e-3, rel=2e-3)
    assert fields["stage_1_lambda"] == pytest.approx(6e-3, rel=1e-2)
    assert (fields["near"], fields["far"]) == (1.0, 10.0)
    assert fields["bytes"] == len(stream_bytes)
    assert fields["model_id"] == b"no model".hex()
    assert [section["name"] for section in fields["sections"]] == ["cameras", "B1", "B2"]
    assert fields["bytes"] == fields["overhead_bytes"] + sum(s["payload_bytes"] for s in fields["sections"])
    assert fields["overhead_bytes"] <= 96
    assert fields["damage"] is None


def test_text_shows_size_and_sections(fecosplat, stream_file: Path, stream_bytes: bytes) -> None:
    result = fecosplat("info", stream_file)
    assert result.code == 0
    assert "2 of 448x256" in result.out
    of_stages = "0.005986 in stage 1, 0.001 in stage 2"
    assert f"{of_stages} (a larger one gives a smaller, coarser file)\n" in result.out
    assert f"{len(stream_bytes)} bytes" in result.out
    rows = result.out.split("at byte")[1].splitlines()[1:]
    assert sum(int(row.split()[2]) for row in rows) == len(stream_bytes), "the column of bytes is all of the file"
    assert [line.split()[1] for line in result.out.splitlines()[-4:]] == ["header", "cameras", "B1", "B2"]
    assert result.out.endswith("  stage 2: corrections to stage 1\n")


def test_what_decoding_takes_and_detail_are_said(fecosplat, stream_file: Path) -> None:
    sentence = "; the --lambda that was given may be smaller, because detail follows)"
    with_detail = Path(__file__).parents[2] / "bitstream_spec/vectors/valid/detail-of-one-stage.fcs"
    assert sentence in fecosplat("info", with_detail).out
    assert sentence not in fecosplat("info", stream_file).out
    assert (
        "229,376 pixels in all (sides rounded to multiples of 32), about 0.5 GiB of memory"
        in fecosplat("info", stream_file).out
    )
    decoding = json.loads(fecosplat("info", stream_file, "--json").out)["decoding"]
    assert decoding["pixels"] == 2 * 256 * 448


def test_damage_is_described_and_fails(fecosplat, stream_file: Path, stream_bytes: bytes) -> None:
    stream_file.write_bytes(stream_bytes[:-1] + bytes([stream_bytes[-1] ^ 1]))
    result = fecosplat("info", stream_file, "--json")
    assert result.code == 1
    assert [section["intact"] for section in json.loads(result.out)["sections"]] == [True, True, False]
    assert result.err.startswith(f"fecosplat: {stream_file}: section B2 at byte ")
    assert "CRC-32" in result.err
    stream_file.write_bytes(stream_bytes[:-1])
    result = fecosplat("info", stream_file)
    assert result.code == 1 and ["depth", "1", "to", "10"] in [line.split() for line in result.out.splitlines()]
    stream_file.write_bytes(stream_bytes[:20])
    result = fecosplat("info", stream_file)
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        f"fecosplat: {stream_file}: header at byte 0: the file ends after 20 bytes, the header needs 28; "
        "copy or download it again.\n"
    )


def test_control_characters_never_reach_the_terminal(fecosplat, tmp_path: Path, stream_bytes: bytes) -> None:
    text = "".join(map(chr, (*range(32), *range(127, 160), 0x2028, 0x202E, 0x2066))) + "</script><script>alert(1)"
    metadata = {"name": "\x1b[31mred\x07", "title": text, "author": text}
    named = write_stream(replace(read_stream(stream_bytes), metadata=metadata))
    for data in (named, named[:-1]):
        file = tmp_path / "evil\x1b]0;title\x07.fcs"
        file.write_bytes(data)
        for options in ((), ("--json",)):
            result = fecosplat("info", file, *options)
            assert all(c.isprintable() or c == "\n" for c in result.out + result.err)
            if options:
                assert json.loads(result.out)["metadata"] == (metadata if data == named else None)


def test_text_shows_title_and_author_with_escaped_control_characters(fecosplat, stream_bytes, tmp_path) -> None:
    data = with_metadata(stream_bytes, {"title": "replaced", "author": "A. B.", "date": "2026-05-31"})
    data = with_metadata(data, {"title": "Fox\x1b[2J", "other": 3})
    (tmp_path / "scene.fcs").write_bytes(data)
    lines = [line.split(maxsplit=1) for line in fecosplat("info", tmp_path / "scene.fcs").out.splitlines() if line]
    shown = {line[0]: line[1] for line in lines if len(line) == 2}
    assert (shown["title"], shown["author"], shown["date"]) == ("Fox\\x1b[2J", "A. B.", "2026-05-31")
    assert "other" not in shown
    assert read_stream(data).payloads == read_stream(stream_bytes).payloads


def test_standard_input_and_pipes_are_read(stream_file: Path, fecosplat) -> None:
    """`cat scene.fcs | fecosplat info -`, and process substitution."""
    described = fecosplat("info", stream_file).out
    command = f"cat {stream_file} | {CONSOLE_SCRIPT} info - && {CONSOLE_SCRIPT} info <(cat {stream_file})"
    result = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == 2 * described


@pytest.mark.parametrize("command", ["info", "view", "decode", "render"])
def test_a_named_pipe_without_a_writer_does_not_hang(fecosplat, command, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(stream_file_module, "SECONDS_WITHOUT_WRITER", 0.1)
    os.mkfifo(tmp_path / "pipe.fcs")
    output = {"info": (), "view": ("--no-browser",), "decode": ("-o", tmp_path / "a.ply"), "render": ("-o", tmp_path)}
    result = fecosplat(command, tmp_path / "pipe.fcs", *output[command])
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        f"fecosplat: {tmp_path / 'pipe.fcs'}: no program wrote to this pipe within 0.1 seconds; start the "
        "program that writes to it, or give a file.\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.fcs"]
