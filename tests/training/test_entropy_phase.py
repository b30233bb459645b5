"""The entropy model's own phase: fewer bits, and nothing else changes."""

from pathlib import Path

import pytest
import torch

from fecocodec.coding.payload import encode_latents
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import FAST
from fecocodec.training.batch_shapes import BatchShapes
from fecocodec.training.checkpoint import load_checkpoint
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.entropy_phase import EntropyPhase, SceneLatents, draw_latents, latents_of, train_entropy_model
from fecocodec.training.export import export_model
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures
from fecocodec.training.run_settings import RunSettings
from fecocodec.training.schedule import Schedule
from fecocodec.training.trainer import Trainer

pytestmark = pytest.mark.usefixtures("one_thread")

LEARNS = ("receiver.prior.", "sender.hyper_analysis.")


def new_trainer(folder: Path) -> Trainer:
    """Networks as training starts with them: a block transform, whose prior has learnt nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    shapes = BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=1, sizes=((64, 64),))
    settings = RunSettings(folder, Configuration(shapes, Schedule(1)), max_minutes=5.0)
    return Trainer(settings, Sources(ProceduralWorld(pattern_textures(13)), None))


def bytes_of(trainer: Trainer, scenes: list[SceneLatents]) -> int:
    """Of real payloads, both stages."""
    prior, total = trainer.receiver.prior, 0
    with torch.no_grad():
        for scene in scenes:
            lambdas = stage_lambdas(torch.tensor([scene.lambda_q]), len(scene.y))
            for stage, (y, lambda_q) in enumerate(zip(scene.y, lambdas, strict=True), start=1):
                context = None if stage == 1 else scene.y1_hat
                z = trainer.sender.hyper_analysis(y)
                total += len(encode_latents(prior, y, z, int(lambda_q), stage, context)[0])
    return total


def test_the_phase_saves_bytes_on_other_scenes_and_leaves_the_other_networks_alone(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    others = draw_latents(trainer, EntropyPhase(1, num_scenes=2, optimisation=FAST))
    before, bytes_before = dict(trainer.average), bytes_of(trainer, others)
    rows = list(train_entropy_model(trainer, EntropyPhase(15, num_scenes=2, learning_rate=1.6e-2, optimisation=FAST)))
    assert [(row["step"], row["skipped"]) for row in rows] == [(15.0, 0.0)]
    assert rows[0]["bpp1"] > 0 and rows[0]["bpp2"] > 0
    assert bytes_of(trainer, others) < 0.9 * bytes_before
    changed = {name for name, value in trainer.average.items() if not torch.equal(value, before[name])}
    assert changed and all(name.startswith(LEARNS) for name in changed)

    saved = load_checkpoint(trainer.checkpoint)["average"]
    assert all(torch.equal(saved[name], value) for name, value in trainer.average.items())
    export_model(trainer.checkpoint, tmp_path / "model", trainer.settings.configuration)
    load_codec(tmp_path / "model", "cpu")


def test_latents_are_those_of_the_sender_at_every_lambda(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    views = trainer.sources.world.sample(
        torch.Generator().manual_seed(3), num_context=2, num_target=1, size=(64, 64)
    ).views.select([0, 1])
    codec = Codec(trainer.sender, trainer.receiver, b"")
    fine, coarse, alone = latents_of(codec, views, (200, 1700, 200), num_alone=1, optimisation=FAST)
    assert fine.y[0].shape == fine.y[1].shape == fine.y1_hat.shape == (2, 32, 8, 8)
    assert float(fine.y[0].std()) > 3 * float(coarse.y[0].std())  # finer steps at lower lambda
    assert not fine.y[0].requires_grad
    assert len(alone.y) == 1 and alone.y1_hat is None
    assert float(alone.y[0].std()) > 1.5 * float(fine.y[0].std())  # the first of two stages is coarser


def test_the_last_of_several_scenes_has_one_stage_alone(tmp_path: Path) -> None:
    phase = EntropyPhase(1, num_scenes=2, optimisation=FAST, alone_every=2)
    assert EntropyPhase(1).alone_every == 8
    assert [len(scene.y) for scene in draw_latents(new_trainer(tmp_path / "run"), phase)] == [2, 2, 2, 1]
