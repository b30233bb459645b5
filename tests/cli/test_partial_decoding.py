"""`fecosplat decode --partial`: what is intact is decoded, and said so.

A stream cut at any byte: what stands whole before the cut is decoded, and nothing else is made of it.
"""

import json
from collections.abc import Callable
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


def ends_of(data: bytes) -> dict[str, int]:
    return {section.name: section.offset + 9 + section.length for section in list_sections(data)}


def cut_at(place: str) -> Callable[[bytes], bytes]:
    """Cut at a boundary of sections, or within one."""

    def cut(data: bytes) -> bytes:
        ends = ends_of(data)
        within = {
            "middle of B1": ends["B1"] - 50,
            "head of B2": ends["B1"] + 4,
            "half of B2": (ends["B1"] + ends["B2"]) // 2,
            "last byte": len(data) - 1,
        }
        return data[: (ends | within)[place]]

    return cut


def with_another_digest(data: bytes) -> bytes:
    """The checksum of the second stage holds: only the digest tells."""
    stream = read_stream(data)
    digests = (stream.header.symbol_digests[0], bytes(8))
    return write_stream(replace(stream, header=replace(stream.header, symbol_digests=digests)))


ENDS = "the file ends after {} bytes"


@pytest.mark.parametrize(
    ("damage", "stages", "cause"),
    [
        (cut_at("B1"), 1, ENDS),
        (cut_at("head of B2"), 1, ENDS),
        (cut_at("half of B2"), 1, ENDS),
        (cut_at("B2"), 2, ENDS),
        (cut_at("last byte"), 2, ENDS),
        (lambda data: data + b"12345", 2, "end at byte"),
        (with_another_digest, 1, "stage 2: the decoded symbols have digest"),
        (lambda data: data, 2, None),
    ],
)
def test_what_is_intact_is_decoded(fecosplat, whole: bytes, tmp_path: Path, output: Path, damage, stages, cause):
    file, data = tmp_path / "cut.fcs", damage(whole)
    file.write_bytes(data)
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial", "--json")
    fields = json.loads(result.out)
    assert (result.code, fields["stages"]) == (0 if cause is None else 3, stages)
    assert read_ply(output / "a.ply").count == fields["gaussians"] > 0
    if cause is None:
        assert "damaged" not in result.err
        return
    assert cause.format(len(data)) in fields["damage"] and "--stages" not in result.err
    what = {1: "only stage 1", 2: "but both stages"}[stages]
    assert result.err.startswith(f"fecosplat: {file}: damaged, {what} could be decoded: ")
    assert result.err.count("\n") == 1


@pytest.mark.parametrize("place", ["cameras", "middle of B1"])
def test_nothing_is_made_of_a_file_without_an_intact_first_stage(fecosplat, whole, tmp_path, output, place) -> None:
    file = tmp_path / "cut.fcs"
    file.write_bytes(cut_at(place)(whole))
    result = fecosplat("decode", file, "-o", output / "a.ply", "--partial")
    assert_refused(result, output, f"{file}: section ...")


EVERY_KIND = (VECTORS / "uncommon" / "unknown-sections.fcs").read_bytes()
"""Two stages among as many unknown sections as there may be."""


def test_the_stages_before_a_cut_are_intact() -> None:
    ends, payloads = ends_of(EVERY_KIND), read_stream(EVERY_KIND).payloads
    around_ends = (ends[name] + step for name in ("B1", "B2") for step in (-1, 0))
    for cut in (*range(0, len(EVERY_KIND), 7), *around_ends):
        num_stages = sum(ends[name] <= cut for name in ("B1", "B2"))
        if num_stages == 0:
            with pytest.raises(BitstreamError):
                read_intact(EVERY_KIND[:cut])
            continue
        part = read_intact(EVERY_KIND[:cut])
        assert part.stream.payloads == payloads[:num_stages] and part.damage is not None
