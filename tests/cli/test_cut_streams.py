"""A stream cut at any byte: what stands whole before the cut is decoded, and nothing else is made of it."""

from pathlib import Path
from random import Random

import pytest
from refusals import assert_refused

from fecocodec.container import list_sections, read_intact, read_stream
from fecocodec.errors import BitstreamError
from fecocodec.splat_files.ply import read_ply
from tests.fuzzing.mutations import VECTORS

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


@pytest.mark.usefixtures("networks")
def test_at_random_places_and_at_every_end_of_a_section(fecosplat, wall: bytes, tmp_path: Path, output: Path) -> None:
    random, ends = Random(4), ends_of_stages(wall)
    file, result_file = tmp_path / "cut.fcs", output / "a.ply"
    boundaries = [section.offset for section in list_sections(wall)]
    for cut in (*boundaries, *ends[:1], *(int(random.random() * len(wall)) for _ in range(12))):
        file.write_bytes(wall[:cut])
        result = fecosplat("decode", file, "-o", result_file, "--partial", "--overwrite")
        if cut < ends[0]:
            assert_refused(result, output, f"{file}: ...")
            continue
        assert result.code == 3 and "damaged, only stage 1 could be decoded" in result.err
        assert read_ply(result_file).count > 0
        result_file.unlink()
