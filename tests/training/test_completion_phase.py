"""Depth completion's own phase: scenes with known disparity, their variations, and a phase that learns."""

import random
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.config import SenderConfig
from fecocodec.errors import InputError
from fecocodec.sender.extractors.depth_completion import MatchedMaps
from fecocodec.training.batch_shapes import BatchShapes
from fecocodec.training.completion_phase import CompletionPhase, completion_loss, draw_scenes, train_completion
from fecocodec.training.completion_scenes import CompletionScene, varied, with_hidden_regions, without_matches
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures
from fecocodec.training.run_settings import RunSettings
from fecocodec.training.schedule import Schedule
from fecocodec.training.trainer import Trainer

pytestmark = pytest.mark.usefixtures("one_thread")
PHASE = CompletionPhase(12, num_scenes=2, sizes=((64, 64),))


def new_trainer(folder: Path, is_monocular: bool = True) -> Trainer:
    shapes = BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=1, sizes=((64, 64),))
    configuration = Configuration(shapes, Schedule(1), sender=SenderConfig(is_monocular=is_monocular))
    settings = RunSettings(folder, configuration, max_minutes=5.0)
    return Trainer(settings, Sources(ProceduralWorld(pattern_textures(13)), None))


@pytest.fixture(scope="module")
def scenes(one_thread: None, tmp_path_factory: pytest.TempPathFactory) -> list[CompletionScene]:
    return list(draw_scenes(new_trainer(tmp_path_factory.mktemp("run")), PHASE))


def test_drawn_scenes_know_all_of_their_disparity(scenes: list[CompletionScene]) -> None:
    for scene in scenes:
        assert scene.is_known.all() and scene.truth.shape == (2, 1, 16, 16)
        assert scene.truth.min() > -0.1 and scene.truth.max() < 1.1
        assert scene.truth.std() > 0.01


def test_a_scene_without_matches_is_what_matching_finds_for_one_view(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path)
    sample = trainer.sources.world.sample(torch.Generator().manual_seed(5), num_context=2, num_target=4, size=(64, 64))
    views = sample.views
    with torch.no_grad():
        alone = trainer.sender.extractor.match(views.images[None, :1], views.cameras.select([0]).as_batch()).maps
    blank = torch.zeros(1, 1, 16, 16)
    scene = CompletionScene(
        MatchedMaps(blank, blank, blank, blank), torch.zeros(1, 3, 64, 64, dtype=torch.uint8), blank, blank, blank > 0
    )
    found = without_matches(scene).maps
    for name in ("disparity", "consistency", "confidence", "extrapolated"):
        torch.testing.assert_close(getattr(found, name), getattr(alone, name))


def test_hidden_regions_lose_their_matches_and_keep_their_truth(scenes: list[CompletionScene]) -> None:
    scene = replace(scenes[0], is_known=torch.zeros_like(scenes[0].is_known))
    sure = replace(scene, maps=replace(scene.maps, consistency=torch.ones_like(scene.truth)))
    hidden = with_hidden_regions(sure, random.Random(3))
    is_hidden = hidden.maps.consistency < 0.5
    assert 0.02 < is_hidden.float().mean() < 0.8
    assert hidden.is_known.all() and torch.equal(hidden.truth, scene.maps.disparity)
    assert torch.equal(hidden.maps.disparity[~is_hidden], scene.maps.disparity[~is_hidden])
    assert not torch.equal(hidden.maps.disparity[is_hidden], scene.maps.disparity[is_hidden])


def test_equal_random_numbers_give_equal_variations(scenes: list[CompletionScene]) -> None:
    first, second = (varied(scenes[0], random.Random(8)) for _ in range(2))
    assert torch.equal(first.maps.consistency, second.maps.consistency)
    assert torch.equal(first.images, second.images)


def test_unknown_disparity_does_not_count(scenes: list[CompletionScene], tmp_path: Path) -> None:
    completion = new_trainer(tmp_path).sender.extractor.completion
    scene = scenes[0]
    left = torch.zeros_like(scene.is_known)
    left[..., :8] = True
    half = replace(scene, is_known=left)
    wrong_elsewhere = replace(half, truth=torch.where(left, scene.truth, scene.truth + 0.3))
    with torch.no_grad():
        assert completion_loss(completion, half)[0] == completion_loss(completion, wrong_elsewhere)[0]
        wrong_there = replace(half, truth=scene.truth + 0.3)
        assert completion_loss(completion, wrong_there)[0] > completion_loss(completion, half)[0] + 0.01


def test_the_phase_lowers_the_error_of_its_scenes_and_changes_nothing_else(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path)
    before = {name: value.clone() for name, value in trainer.average.items()}
    scenes = list(draw_scenes(trainer, PHASE))
    trainer = new_trainer(tmp_path)  # draws the same scenes
    with torch.no_grad():
        errors = [completion_loss(trainer.sender.extractor.completion, scene)[1]["error"] for scene in scenes]
    (row,) = train_completion(trainer, replace(PHASE, num_steps=40))
    assert row["step"] == 40.0
    with torch.no_grad():
        after = [completion_loss(trainer.sender.extractor.completion, scene)[1]["error"] for scene in scenes]
    assert sum(after) < 0.9 * sum(errors)
    changed = {name for name, value in trainer.average.items() if not torch.equal(value, before[name])}
    assert changed and all(name.startswith("sender.extractor.completion.") for name in changed)


def test_a_sender_without_completion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no depth completion"):
        next(train_completion(new_trainer(tmp_path, is_monocular=False), PHASE))
