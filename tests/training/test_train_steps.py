"""The step network alone: it changes, and nothing else does."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.errors import InputError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.distortion import MseDistortion
from fecocodec.sender.fading import LEAST_VIEWS
from fecocodec.sender.latent_optimisation import gaussians_of
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import StageInputs
from fecocodec.training import loop, step_learning
from fecocodec.training.batch import Batch, BatchShapes
from fecocodec.training.loop import SCENES_OF_A_STEP
from fecocodec.training.model_weights import load_model_weights, write_model
from fecocodec.training.train_steps import STEPS, train_step_network, with_sharp_steps
from tests.training.tiny_runs import changed, copied, synthetic_sources

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(autouse=True)
def two_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    config = OptimisationConfig(num_steps=2, extra_step_below=(), distortion=MseDistortion())
    monkeypatch.setattr("fecocodec.training.train_steps.DEFAULT", config)


def new_codec(step_channels: int = 32) -> Codec:
    torch.manual_seed(0)
    receiver = ReceiverConfig()
    return Codec(Sender(SenderConfig(step_channels=step_channels), receiver), Receiver(receiver), b"")


def trained(codec: Codec, views: int = 2) -> list[dict[str, float]]:
    """Train for one step of the optimiser."""
    shapes = BatchShapes(num_scenes=4, view_shares=((views, 1.0),), num_target=1, sizes=((64, 64),))
    schedule = replace(STEPS.schedule, num_steps=1)
    configuration = replace(STEPS, shapes=shapes, schedule=schedule, lambda_range=(1e-3, 1e-3))
    return list(train_step_network(codec, synthetic_sources(), configuration))


def test_the_network_changes_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes are moved to the device of the networks."""
    moved: list[str] = []
    to = Batch.to

    def recorded(batch: Batch, device: str) -> Batch:
        moved.append(device)
        return to(batch, device)

    monkeypatch.setattr(Batch, "to", recorded)
    codec = new_codec()
    before = deepcopy(codec)
    rows = trained(codec)
    assert moved == ["cpu"] * SCENES_OF_A_STEP
    assert [(row["step"], row["skipped"]) for row in rows] == [(1.0, 0.0)]
    names = {f"{name}{stage}" for name in ("loss", "context", "target", "log_bits") for stage in (1, 2)}
    assert names <= rows[0].keys()
    learned = changed(codec.sender, copied(before.sender))
    assert learned and all(name.startswith("steps.") for name in learned)
    assert changed(codec.receiver, copied(before.receiver)) == set()


@pytest.mark.parametrize("views", [LEAST_VIEWS - 1, LEAST_VIEWS])
def test_many_views_are_faded_as_in_encoding(monkeypatch: pytest.MonkeyPatch, views: int) -> None:
    found: list[tuple[int, bool]] = []

    def recorded(encoder: SceneEncoder, inputs: StageInputs, y_hat: Tensor) -> Gaussians:
        found.append((inputs.stage, inputs.fading is not None))
        return gaussians_of(encoder, inputs, y_hat)

    monkeypatch.setattr(step_learning, "gaussians_of", recorded)
    monkeypatch.setattr(loop, "SCENES_OF_A_STEP", 1)
    trained(new_codec(), views)
    assert set(found) == {(1, False), (2, views == LEAST_VIEWS)}


def test_the_network_for_sharper_pictures_is_the_mean_of_what_was_trained() -> None:
    codec = new_codec()
    own = codec.sender.steps.log_scale.bias
    states = [{name: value + shift for name, value in codec.sender.steps.state_dict().items()} for shift in (1.0, 3.0)]
    beside, between = (with_sharp_steps(codec, states, is_between) for is_between in (False, True))
    for found, share in ((beside, 0.0), (between, 1.0)):
        assert found.sender.config.has_sharp_steps and found.receiver is codec.receiver
        torch.testing.assert_close(found.sender.sharp_steps.log_scale.bias, own + 2.0)
        torch.testing.assert_close(found.sender.steps.log_scale.bias, own + share)
    assert codec.sender.sharp_steps is None
    with pytest.raises(InputError, match="no network that proposes steps; train one with the configuration compact"):
        trained(new_codec(step_channels=0))


def test_models_with_and_without_the_network_start_each_other(tmp_path: Path) -> None:
    codec = new_codec()
    torch.nn.init.ones_(codec.sender.steps.log_scale.bias)
    write_model(tmp_path / "model", serialise_receiver(codec.receiver), codec.sender)
    assert load_codec(tmp_path / "model", "cpu").sender.steps is not None

    without = new_codec(step_channels=0)
    load_model_weights(without.sender, without.receiver, tmp_path / "model")
    assert without.sender.steps is None
    write_model(tmp_path / "plain", serialise_receiver(without.receiver), without.sender)
    load_model_weights(codec.sender, codec.receiver, tmp_path / "plain")
    assert bool((codec.sender.steps.log_scale.bias == 1).all())  # its own, because the model has none
