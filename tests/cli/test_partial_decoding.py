"""`fecosplat decode --partial`: what is intact is decoded, and said so.

A stream cut at any byte: what stands whole before the cut is decoded, and nothing else is made of it.
"""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from refusals import assert_refused

from fecocodec import read_ply
from fecocodec.container import list_sections, read_intact, read_stream, write_stream
from fecocodec.errors import BitstreamError
from tests.fuzzing.mutations import VECTORS

pytestmark = pytest.mark.usefixtures("networks")


@pytest.fixture(scope="module")
def whole(wall: bytes) -> bytes:
    """Two stages and metadata."""
    return write_stream(replace(read_stream(wall), metadata={"name": "wall"}))


def end_of(data: bytes, name: str) -> int:
    section = next(section for section in list_sections(data) if section.name == name)
    return section.offset + 9 + section.length


def cuts(whole: bytes) -> dict[str, int]:
    """Every boundary of sections behind B1, and places within the sections."""
    ends = {name: end_of(whole, name) for name in ("B1", "B2")}
    return ends | {
        "head of B2": ends["B1"] + 4,
        "half of B2": (ends["B1"] + ends["B2"]) // 2,
        "last byte": len(whole) - 1,
    }


@pytest.mark.parametrize(
    ("place", "stages"),
    [("B1", 1), ("head of B2", 1), ("half of B2", 1), ("B2", 2), ("last byte", 2)],
)
def test_a_cut_file_gives_what_is_intact(
    fecosplat, whole: bytes, tmp_path: Path, output: Path, place: str, stages: int
) -> None:
    file, result_file = tmp_path / "cut.fcs", output / "a.ply"
    file.write_bytes(whole[: cuts(whole)[place]])
    result = fecosplat("decode", file, "-o", result_file, "--partial", "--json")
    fields = json.loads(result.out)
    assert (result.code, fields["stages"]) == (3, stages)
    assert f"the file ends after {cuts(whole)[place]} bytes" in fields["damage"]
    what = {1: "only stage 1", 2: "but both stages"}[stages]
    assert (
        result.err.startswith(f"fecosplat: {file}: damaged, {what} could be decoded: ") and result.err.count("\n") == 1
    )
    assert "--stages" not in result.err
    assert read_ply(result_file).count == fields["gaussians"] > 0


@pytest.mark.parametrize("place", ["cameras", "middle of B1"])
def test_nothing_is_made_of_a_file_without_an_intact_first_stage(
    fecosplat, whole: bytes, tmp_path: Path, output: Path, place: str
) -> None:
    file = tmp_path / "cut.fcs"
    at = end_of(whole, "cameras") if place == "cameras" else end_of(whole, "B1") - 50
    file.write_bytes(whole[:at])
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial")
    assert_refused(result, output, f"{file}: section ...")


def test_a_whole_file_is_decoded_as_ever(fecosplat, whole: bytes, tmp_path: Path, output: Path) -> None:
    file = tmp_path / "whole.fcs"
    file.write_bytes(whole)
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial")
    assert result.code == 0 and "damaged" not in result.err


def test_bytes_after_the_end_do_not_harm_a_stage(fecosplat, whole: bytes, tmp_path: Path, output: Path) -> None:
    file = tmp_path / "longer.fcs"
    file.write_bytes(whole + b"12345")
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial")
    assert result.code == 3 and "damaged, but both stages could be decoded: end at byte" in result.err


def test_a_second_stage_with_other_symbols_than_promised_is_left_out(
    fecosplat, whole: bytes, tmp_path: Path, output: Path
) -> None:
    """Its checksum holds: only the digest tells."""
    stream = read_stream(whole)
    digests = (stream.header.symbol_digests[0], bytes(8))
    file = tmp_path / "other.fcs"
    file.write_bytes(write_stream(replace(stream, header=replace(stream.header, symbol_digests=digests))))
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial", "--json")
    fields = json.loads(result.out)
    assert (result.code, fields["stages"]) == (3, 1)
    assert fields["damage"].startswith("stage 2: the decoded symbols have digest")


EVERY_KIND = (VECTORS / "uncommon" / "unknown-sections.fcs").read_bytes()
"""Two stages among as many unknown sections as there may be."""


def ends_of_stages(data: bytes) -> list[int]:
    sections = [section for section in list_sections(data) if section.name in ("B1", "B2")]
    return [section.offset + 9 + section.length for section in sections]


def test_at_every_byte_the_stages_before_it_are_intact() -> None:
    ends, payloads = ends_of_stages(EVERY_KIND), read_stream(EVERY_KIND).payloads
    for cut in range(len(EVERY_KIND)):
        num_stages = sum(end <= cut for end in ends)
        if num_stages == 0:
            with pytest.raises(BitstreamError):
                read_intact(EVERY_KIND[:cut])
            continue
        part = read_intact(EVERY_KIND[:cut])
        assert part.stream.payloads == payloads[:num_stages] and part.damage is not None
