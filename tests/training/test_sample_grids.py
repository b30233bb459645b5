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


def test_a_grid_has_a_row_a_scene_and_shows_photographs_stages_and_disparity(run: Trainer) -> None:
    path = RunMonitor(run).draw_samples()
    assert path == run.settings.folder / "samples" / "step_000003.png"
    tiles = 2 + 1 + 2 + 2  # context, target, target after each stage, its disparity
    assert read_image(path).shape == (3, 64 * NUM_SCENES, 64 * tiles)


def test_drawing_changes_nothing_that_training_depends_on(run: Trainer) -> None:
    before, noise = run.generator.get_state(), torch.get_rng_state()
    weights = [value.clone() for value in run.networks.state_dict().values()]
    RunMonitor(run).draw_samples()
    assert torch.equal(run.generator.get_state(), before) and torch.equal(torch.get_rng_state(), noise)
    assert all(torch.equal(a, b) for a, b in zip(weights, run.networks.state_dict().values(), strict=True))
    assert all(parameter.grad is None for parameter in run.networks.parameters())


def test_every_run_shows_the_same_scenes(run: Trainer, tmp_path: Path) -> None:
    other = trainer(tmp_path, seed=9)
    other.step = 3
    shown, again = (read_image(RunMonitor(it).draw_samples())[..., : 3 * 64] for it in (run, other))
    assert torch.equal(shown, again)


def test_the_first_phase_shows_its_only_stage(run: Trainer, tmp_path: Path) -> None:
    assert read_image(RunMonitor(trainer(tmp_path)).draw_samples()).shape[-1] == 64 * (2 + 1 + 1 + 1)
