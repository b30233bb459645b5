"""The second receiver, which knows FORMAT.md alone, makes the reference Gaussians of models and numbers of views."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.receiver.decode import decode
from tests.bitstream_spec.second_reader import read_gaussians
from tests.vectors.gaussian_difference import beyond, without_rendering
from tests.vectors.gaussian_samples import PAPER_STREAM, model_of, read_samples, table
from tests.vectors.tiny_model import VECTORS

SCENES = [f"valid/scene-{DEFAULT_MODEL}-{kind}.fcs" for kind in ("one-view", "three-views", "five-views")]


@pytest.mark.parametrize("name", [*SCENES, PAPER_STREAM])
def test_it_makes_the_reference_gaussians(name: str) -> None:
    data, model = (VECTORS / name).read_bytes(), model_of(name)
    rows = torch.from_numpy(read_gaussians.read(data, model or SHIPPED / DEFAULT_MODEL))
    found = table(decode(data, background=None, merging=None, model=model).gaussians)
    assert beyond(without_rendering(data, found, rows), "full") == []
    reference = read_samples((VECTORS / name).with_suffix(".f32"))
    assert beyond(without_rendering(data, reference, rows[::16]), "full") == []


def test_its_program_writes_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream, output = VECTORS / PAPER_STREAM, tmp_path / "rows.f32"
    assert read_gaussians.main(["", str(stream), str(VECTORS / "paper"), str(output)]) == 0
    rows = np.fromfile(output, "<f4").reshape(-1, 38)
    assert np.isfinite(rows).all() and capsys.readouterr().out == f"{len(rows)} Gaussians\n"
    faulty = VECTORS / "faulty" / "header-crc-32.fcs"
    assert read_gaussians.main(["", str(faulty), str(VECTORS / "paper"), str(output)]) == 1
    assert capsys.readouterr().err.startswith(f"{faulty}: ")
