"""The receiver's own phase: better pictures between the views from refined latents, and nothing else changes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.receiver.model import Receiver
from fecocodec.sender.encode import load_profile
from fecocodec.training.batch_shapes import BatchShape, BatchShapes
from fecocodec.training.checkpoint import load_checkpoint
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.export import export_model
from fecocodec.training.loop import RunSettings, Trainer
from fecocodec.training.receiver_phase import CodedScene, ReceiverPhase, code_scene, loss_of_scene, train_receiver
from fecocodec.training.scenes import ProceduralWorld
from fecocodec.training.schedule import Schedule
from fecocodec.training.textures import pattern_textures

pytestmark = pytest.mark.usefixtures("one_thread")

LEARNS = ("receiver.synthesis.", "receiver.update.join.", "receiver.update.block.", "receiver.predictor.")
SHAPE = BatchShape(1, num_context=2, num_target=1, size=(64, 64))


def new_trainer(folder: Path) -> Trainer:
    folder.mkdir(parents=True, exist_ok=True)
    shapes = BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=1, sizes=((64, 64),))
    settings = RunSettings(folder, Configuration(shapes, Schedule(1)), max_minutes=5.0)
    return Trainer(settings, Sources(ProceduralWorld(pattern_textures(13)), None))


def loss_on(receiver: Receiver, scenes: list[CodedScene]) -> float:
    with torch.no_grad():
        return sum(float(loss_of_scene(receiver, scene)[0]) for scene in scenes) / len(scenes)


def test_the_phase_shows_its_scenes_better_and_leaves_the_other_networks_alone(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    trainer.generator.manual_seed(5)
    scenes = [coded for _ in range(3) for coded in code_scene(trainer, trainer.receiver, SHAPE)]
    before, loss_before = dict(trainer.average), loss_on(trainer.receiver, scenes)
    trainer.generator.manual_seed(5)  # the phase will code the same
    phase = ReceiverPhase(num_steps=30, learning_rate=1e-3, scenes_of_a_step=1, fresh_share=0.0, least_scenes=3)
    rows = list(train_receiver(trainer, phase))
    assert [(row["step"], row["skipped"]) for row in rows] == [(30.0, 0.0)]
    assert {"mse", "mse_context", "disparity"} <= rows[0].keys()
    assert loss_on(trainer.receiver, scenes) < 0.9 * loss_before
    changed = {name for name, value in trainer.average.items() if not torch.equal(value, before[name])}
    assert changed and all(name.startswith(LEARNS) for name in changed)

    saved = load_checkpoint(trainer.checkpoint)["average"]
    assert all(torch.equal(saved[name], value) for name, value in trainer.average.items())
    export_model(trainer.checkpoint, tmp_path / "model", trainer.settings.configuration)
    load_profile(tmp_path / "model", "cpu")


def test_stopped_before_its_end_it_leaves_the_checkpoint(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    trainer.save(trainer.checkpoint)
    saved = trainer.checkpoint.read_bytes()
    rows = train_receiver(trainer, ReceiverPhase(num_steps=60, scenes_of_a_step=1, fresh_share=0.0, least_scenes=1))
    assert next(rows)["step"] == 50
    rows.close()
    assert trainer.checkpoint.read_bytes() == saved


def test_scenes_are_coded_as_files_are_in_two_stages_and_now_and_then_in_one(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    coded = [scene for _ in range(6) for scene in code_scene(trainer, trainer.receiver, SHAPE)]
    assert {len(scene.y_hat) for scene in coded} == {1, 2}
    for scene in coded:
        assert len(scene.lambdas_q) == len(scene.y_hat)
        assert all(y.shape == (2, 32, 8, 8) and not y.requires_grad for y in scene.y_hat)
        assert len(scene.y_hat) == 1 or scene.lambdas_q[0] > scene.lambdas_q[1]  # stage 1 is coarser


def test_every_stage_of_a_scene_counts(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    scene = next(s for _ in range(10) for s in code_scene(trainer, trainer.receiver, SHAPE) if len(s.y_hat) == 2)
    whole, _ = loss_of_scene(trainer.receiver, scene)
    for stage in (0, 1):
        y_hat = list(scene.y_hat)
        y_hat[stage] = torch.zeros_like(y_hat[stage])
        without, _ = loss_of_scene(trainer.receiver, replace(scene, y_hat=tuple(y_hat)))
        assert not torch.allclose(whole, without, rtol=1e-4)
