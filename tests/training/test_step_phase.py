"""The phase of the step network: steps get better for the scenes it sees, and nothing else changes."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.config import SenderConfig
from fecocodec.errors import InputError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.sender.codec import load_codec
from fecocodec.sender.distortion import MseDistortion
from fecocodec.sender.fading import LEAST_VIEWS
from fecocodec.sender.latent_optimisation import gaussians_of
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import StageInputs
from fecocodec.training import step_learning
from fecocodec.training.batch import Batch
from fecocodec.training.batch_shapes import BatchShapes
from fecocodec.training.checkpoint import load_checkpoint
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.export import export_model
from fecocodec.training.fine_tuning import load_model_weights
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures
from fecocodec.training.run_settings import RunSettings
from fecocodec.training.samples import Sample
from fecocodec.training.schedule import Schedule
from fecocodec.training.step_phase import SCENES_OF_A_STEP, StepPhase, train_step_network
from fecocodec.training.trainer import Trainer

pytestmark = pytest.mark.usefixtures("one_thread")

STEPS = OptimisationConfig(num_steps=2, extra_step_below=(), distortion=MseDistortion())


class OneScene:
    """A source that always gives the same drawn scene."""

    def __init__(self) -> None:
        self._world = ProceduralWorld(pattern_textures(13))

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        again = torch.Generator().manual_seed(3)
        return self._world.sample(again, num_context=num_context, num_target=num_target, size=size)


def new_trainer(folder: Path, step_channels: int = 32, views: int = 2) -> Trainer:
    folder.mkdir(parents=True, exist_ok=True)
    shapes = BatchShapes(num_scenes=4, view_shares=((views, 1.0),), num_target=1, sizes=((64, 64),))
    sender = SenderConfig(step_channels=step_channels)
    configuration = Configuration(shapes, Schedule(1), lambda_range=(1e-3, 1e-3), sender=sender)
    return Trainer(RunSettings(folder, configuration, max_minutes=5.0), Sources(OneScene(), None))


def test_the_phase_changes_the_network_and_nothing_else(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    before = dict(trainer.average)
    rows = list(train_step_network(trainer, StepPhase(2, optimisation=STEPS)))
    assert [(row["step"], row["skipped"]) for row in rows] == [(2.0, 0.0)]
    assert {f"{name}{stage}" for name in ("loss", "context", "target", "log_bits") for stage in (1, 2)} <= rows[
        0
    ].keys()
    changed = {name for name, value in trainer.average.items() if not torch.equal(value, before[name])}
    assert changed and all(name.startswith("sender.steps.") for name in changed)
    assert all(p.requires_grad for p in trainer.networks.parameters())
    saved = load_checkpoint(trainer.checkpoint)["average"]
    assert all(torch.equal(saved[name], value) for name, value in trainer.average.items())


def test_scenes_are_moved_to_the_device_of_the_networks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    moved: list[str] = []
    to = Batch.to

    def recorded(batch: Batch, device: str) -> Batch:
        moved.append(device)
        return to(batch, device)

    monkeypatch.setattr(Batch, "to", recorded)
    trainer = new_trainer(tmp_path / "run")
    list(train_step_network(trainer, StepPhase(1, optimisation=STEPS)))
    assert moved == [trainer.settings.device] * SCENES_OF_A_STEP


@pytest.mark.parametrize("views", [LEAST_VIEWS - 1, LEAST_VIEWS])
def test_many_views_are_faded_as_in_encoding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, views: int) -> None:
    found: list[tuple[int, bool]] = []

    def recorded(encoder: SceneEncoder, inputs: StageInputs, y_hat: Tensor) -> Gaussians:
        found.append((inputs.stage, inputs.fading is not None))
        return gaussians_of(encoder, inputs, y_hat)

    monkeypatch.setattr(step_learning, "gaussians_of", recorded)
    list(train_step_network(new_trainer(tmp_path / "run", views=views), StepPhase(1, optimisation=STEPS)))
    assert set(found) == {(1, False), (2, views == LEAST_VIEWS)}


def test_models_with_and_without_the_network_start_each_other(tmp_path: Path) -> None:
    trainer = new_trainer(tmp_path / "run")
    assert trainer.sender.steps is not None
    torch.nn.init.ones_(trainer.sender.steps.log_scale.bias)
    trainer.begin_average()
    trainer.save(trainer.checkpoint)
    export_model(trainer.checkpoint, tmp_path / "model", trainer.settings.configuration)
    assert load_codec(tmp_path / "model", "cpu").sender.steps is not None

    without = new_trainer(tmp_path / "other", step_channels=0)
    load_model_weights(without.sender, without.receiver, tmp_path / "model")
    assert without.sender.steps is None
    without.begin_average()
    without.save(without.checkpoint)
    export_model(without.checkpoint, tmp_path / "plain", without.settings.configuration)
    load_model_weights(trainer.sender, trainer.receiver, tmp_path / "plain")
    assert bool((trainer.sender.steps.log_scale.bias == 1).all())  # its own, because the model has none


def test_a_sender_without_the_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no network that proposes steps; choose the configuration compact"):
        next(train_step_network(new_trainer(tmp_path, step_channels=0), StepPhase(1)))
