"""The second receiver, which knows FORMAT.md alone, makes the reference Gaussians of models and numbers of views."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.coding.visibility import visibility_of
from fecocodec.container import read_stream
from fecocodec.receiver.decode import emitted_gaussians, predict_with, receiver_of
from fecocodec.splatting.emission import Emission
from tests.bitstream_spec.second_reader import read_gaussians
from tests.vectors.gaussian_difference import beyond, without_rendering
from tests.vectors.gaussian_samples import PAPER_STREAM, model_of, read_samples, table
from tests.vectors.tiny_model import VECTORS

LAYER_OPACITY = 0.95  # FORMAT.md, section 9.2
OF_SCENES = [
    (f"valid/scene-{DEFAULT_MODEL}-{kind}.fcs", is_filled)
    for kind, is_filled in (("one-view", True), ("three-views", False), ("five-views", True), ("nine-views", False))
]


@pytest.mark.parametrize(("name", "is_filled"), [*OF_SCENES, (PAPER_STREAM, False)])
def test_it_makes_the_reference_gaussians(name: str, is_filled: bool) -> None:
    """A cut-out, more than eight views and the paper's method have no layer behind near surfaces."""
    data, model = (VECTORS / name).read_bytes(), model_of(name)
    scene = predict_with(receiver_of(read_stream(data).header.model_id, model, "cpu"), data)
    visibility = visibility_of(scene.stream, scene.config.gaussians_per_side)
    plain = Emission(visibility=None if visibility is None else torch.from_numpy(visibility), is_culled=True)
    filled, expected = (
        table(emitted_gaussians(scene.prediction, scene.cameras, scene.config, replace(plain, is_filled=with_layer)))
        for with_layer in (is_filled, False)
    )
    rows = torch.from_numpy(read_gaussians.read(data, model or SHIPPED / DEFAULT_MODEL, is_filled=True))
    is_layer = rows[:, 10] == torch.tensor(LAYER_OPACITY)
    found, layer = rows[~is_layer], rows[is_layer]
    assert beyond(without_rendering(data, expected, found), "full") == []
    reference = read_samples((VECTORS / name).with_suffix(".f32"))
    assert beyond(without_rendering(data, reference, found[::16]), "full") == []
    assert bool(len(layer)) == is_filled
    if is_filled:
        assert beyond(without_rendering(data, filled[len(expected) :], layer), "full") == []


def test_its_program_writes_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream, output = VECTORS / PAPER_STREAM, tmp_path / "rows.f32"
    assert read_gaussians.main(["", str(stream), str(VECTORS / "paper"), str(output)]) == 0
    rows = np.fromfile(output, "<f4").reshape(-1, 38)
    assert np.isfinite(rows).all() and capsys.readouterr().out == f"{len(rows)} Gaussians\n"
    faulty = VECTORS / "faulty" / "header-crc-32.fcs"
    assert read_gaussians.main(["", str(faulty), str(VECTORS / "paper"), str(output)]) == 1
    assert capsys.readouterr().err.startswith(f"{faulty}: ")
