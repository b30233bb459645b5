"""Gaussians of scenes and of the paper's method agree with the stored reference values (FORMAT.md, section 15)."""

import pytest
import torch

from fecocodec.checkpoint import DEFAULT_MODEL
from fecocodec.coding.camera_packing import unpack
from fecocodec.container import read_stream
from fecocodec.receiver.decode import decode
from tests.vectors.gaussian_difference import Difference, beyond, matched, tolerance, without_rendering
from tests.vectors.gaussian_samples import EVERY, PAPER_STREAM, like_samples, model_of, read_samples, table
from tests.vectors.tiny_model import VECTORS

SCENES = sorted(VECTORS.glob("valid/scene-*.fcs"))
PAIR = VECTORS / "valid" / f"scene-{DEFAULT_MODEL}.fcs"
DATA, ROWS = PAIR.read_bytes(), read_samples(PAIR.with_suffix(".f32"))


@pytest.mark.parametrize("path", [*SCENES, VECTORS / PAPER_STREAM], ids=lambda path: path.stem)
def test_the_reference_is_met(path) -> None:
    data, model = path.read_bytes(), model_of(path.relative_to(VECTORS).as_posix())
    reference = read_samples(path.with_suffix(".f32"))
    found = table(decode(data, background=None, merging=None, model=model).gaussians)
    assert len(reference) == pytest.approx(len(found) / EVERY, abs=2)
    difference = without_rendering(data, reference, like_samples(found, reference))
    assert beyond(difference, "full") == []


@pytest.mark.parametrize("kind", ["full", "reduced"])
def test_the_specification_bounds_everything_that_is_measured(kind: str) -> None:
    assert tolerance(kind).keys() == Difference.__dataclass_fields__.keys()


def test_the_same_gaussians_are_matched() -> None:
    fewer = torch.cat((ROWS[:10], ROWS[11:300], ROWS[301:]))
    one, other = matched(DATA, ROWS, fewer)
    assert torch.equal(one, other) and torch.equal(other, fewer)
    one, other = matched(DATA, fewer, ROWS)
    assert torch.equal(one, fewer) and torch.equal(other, fewer)
    here, there = torch.cat((ROWS[:10], ROWS[11:])), torch.cat((ROWS[:300], ROWS[301:]))
    one, other = matched(DATA, here, there)
    assert torch.equal(one, other) and len(one) == len(ROWS) - 2


def test_what_moved_is_noticed_but_for_one_colour_of_a_thousand() -> None:
    moved = ROWS.clone()
    moved[7, :3] *= 1.1
    moved[:, 11:14] += 0.05
    difference = without_rendering(DATA, ROWS, moved)
    assert difference.position_peak > 0.03 and difference.position_rms < difference.position_peak
    assert beyond(difference, "full") == ["position_rms", "position_peak", "colour_rms", "colour_peak"]
    assert difference.colour_rms == pytest.approx(0.0141, rel=0.01)
    leaning = ROWS.clone()
    leaning[:, 14:] += 0.1
    assert without_rendering(DATA, ROWS, leaning).colour_rms > 0.01
    rows = ROWS.repeat(2, 1)
    assert 1000 <= len(rows) < 2000
    other = rows.clone()
    other[7, 11:] += 0.1
    assert without_rendering(DATA, rows, other).colour_peak == 0.0
    other[8, 11:] += 0.1
    assert without_rendering(DATA, rows, other).colour_peak > 0.01


@pytest.mark.parametrize("depth", [10.0, 1000.0])
def test_rounding_of_inverse_depth_is_the_same_at_all_depths(depth: float) -> None:
    cameras = unpack(read_stream(DATA).cameras)
    centre, forward = cameras.extrinsics[0, :3, 3].double(), cameras.extrinsics[0, :3, 2].double()
    tables = []
    for inverse in (1.0 / depth, 1.0 / depth + 1e-5):  # in units of 1 / near
        tables.append(ROWS.double())
        tables[-1][7, :3] = centre + forward * cameras.near.double() / inverse
    found = without_rendering(DATA, *tables)
    assert found.position_peak == pytest.approx(1e-5, rel=0.05)
