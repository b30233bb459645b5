"""Sample pictures of fixed scenes during training."""

from pathlib import Path

import pytest
import torch

from fecocodec.photographs.images import read_image
from fecocodec.training.run_monitor import NUM_SCENES, RunMonitor
from fecocodec.training.trainer import Trainer
from tests.training.test_loop import trainer


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    it = trainer(tmp_path_factory.mktemp("grids"))
    it.step = 3  # past the warm-up: two stages
    return it


def test_every_run_shows_the_same_scenes_and_drawing_changes_nothing_else(run: Trainer, tmp_path: Path) -> None:
    """A row a scene: photographs, then the targets after each stage, then disparity."""
    before, noise = run.generator.get_state(), torch.get_rng_state()
    weights = [value.clone() for value in run.networks.state_dict().values()]
    path = RunMonitor(run).draw_samples()
    assert torch.equal(run.generator.get_state(), before) and torch.equal(torch.get_rng_state(), noise)
    assert all(torch.equal(a, b) for a, b in zip(weights, run.networks.state_dict().values(), strict=True))
    assert all(parameter.grad is None for parameter in run.networks.parameters())
    assert path == run.settings.folder / "samples" / "step_000003.png"
    tiles = 2 + 1 + 2 + 2  # context, target, target after each stage, its disparity
    assert read_image(path).shape == (3, 64 * NUM_SCENES, 64 * tiles)
    other = trainer(tmp_path, seed=9)
    other.step = 3
    shown, again = (read_image(of)[..., : 3 * 64] for of in (path, RunMonitor(other).draw_samples()))
    assert torch.equal(shown, again)


def test_the_first_phase_shows_its_only_stage(run: Trainer, tmp_path: Path) -> None:
    assert read_image(RunMonitor(trainer(tmp_path)).draw_samples()).shape[-1] == 64 * (2 + 1 + 1 + 1)
