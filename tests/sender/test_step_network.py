"""The network that proposes steps: before training it changes no byte, and its steps are taken, checked and undone."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.config import SenderConfig
from fecocodec.container.lambda_quantisation import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.sender.codec import Codec, load_sender, serialise_sender
from fecocodec.sender.encode import encode_with
from fecocodec.sender.latent_optimisation import Objective, Slope, descend
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import DEFAULT, config_of_effort
from fecocodec.sender.step_network import LARGEST_LOG_SCALE, StepNetwork
from tests.example_scenes import example_views

LAMBDA_Q = quantise_lambda(1e-3)


def with_steps(codec: Codec) -> Codec:
    """The same codec with an untrained network."""
    sender = Sender(replace(codec.sender.config, step_channels=32), codec.receiver.config)
    initial = {name: value for name, value in sender.state_dict().items() if name.startswith("steps.")}
    sender.load_state_dict(initial | dict(codec.sender.state_dict()))
    return replace(codec, sender=sender.eval().requires_grad_(False))


def test_an_untrained_network_changes_no_byte_and_a_changed_one_does(codec: Codec) -> None:
    views, config = example_views(2), DEFAULT.with_steps(3)
    plain = encode_with(codec, views, LAMBDA_Q, 1, config)
    other = with_steps(codec)
    assert encode_with(other, views, LAMBDA_Q, 1, config) == plain
    assert other.sender.steps is not None
    torch.nn.init.constant_(other.sender.steps.log_scale.bias, 2.0)  # steps of 7.4 times the length
    longer = [encode_with(other, views, LAMBDA_Q, 1, config) for _ in range(2)]
    assert longer[0] == longer[1] != plain


def test_sharpness_is_the_share_of_the_sharp_network(codec: Codec) -> None:
    views, config = example_views(2), DEFAULT.with_steps(1)
    both = with_steps(codec)
    sender = Sender(replace(both.sender.config, has_sharp_steps=True), codec.receiver.config)
    sharp = {f"sharp_{name}": value for name, value in both.sender.state_dict().items() if name.startswith("steps.")}
    sender.load_state_dict(dict(both.sender.state_dict()) | sharp)
    assert sender.sharp_steps is not None and both.sender.steps is not None
    torch.nn.init.constant_(sender.sharp_steps.log_scale.bias, 1.0)
    both = replace(both, sender=sender.eval().requires_grad_(False))
    assert both.sender.steps is not None

    def coded(bias: float, sharpness: float = 0.0) -> bytes:
        assert both.sender.steps is not None
        torch.nn.init.constant_(both.sender.steps.log_scale.bias, bias)
        return encode_with(both, views, LAMBDA_Q, 1, replace(config, sharpness=sharpness))

    assert coded(0.0, 0.25) == coded(0.25) != coded(0.0) == encode_with(codec, views, LAMBDA_Q, 1, config)
    assert coded(0.0, 1.0) == coded(1.0) == coded(0.5, 1.0)
    assert coded(0.25, -1.0) == coded(-0.5)  # as far on the other side


def test_a_sharpness_that_is_not_possible_is_refused(codec: Codec) -> None:
    with pytest.raises(InputError, match="this model has no network for `sharpness`; leave it out"):
        encode_with(with_steps(codec), example_views(2), LAMBDA_Q, config=replace(DEFAULT, sharpness=0.5))
    with pytest.raises(InputError, match=r"sharpness is 1.5; it must be from -1 to 1"):
        config_of_effort("best", 1.5)
    with pytest.raises(InputError, match=r"sharpness is nan; it must be from -1 to 1"):
        config_of_effort("best", float("nan"))
    with pytest.raises(InputError, match=r"sharpness -0.5 needs steps, which `effort` fast does not take"):
        config_of_effort("fast", -0.5)
    assert config_of_effort(DEFAULT) is DEFAULT and config_of_effort("best", 0.5).sharpness == 0.5


def test_the_scale_of_the_gradient_is_bounded(codec: Codec) -> None:
    network = StepNetwork(32, 128, 32)
    torch.nn.init.constant_(network.log_scale.bias, 1e6)
    gradient = torch.ones(2, 32, 4, 4)
    condition = codec.receiver.condition(torch.tensor([100, 100]), 1)
    zero, errors = torch.zeros_like(gradient), torch.zeros(2, 3, 32, 32)
    with torch.no_grad():
        known = network.prepare(torch.zeros(2, 128, 8, 8), torch.zeros(2, 128, 1, 1))
        step = network(gradient, zero, zero, zero, 1.0, errors, known, condition)
    assert torch.allclose(step, -gradient * torch.tensor(LARGEST_LOG_SCALE).exp())


def test_weights_files_hold_the_network_only_where_there_is_one(codec: Codec, tmp_path: Path) -> None:
    path = tmp_path / "sender.safetensors"
    path.write_bytes(serialise_sender(with_steps(codec).sender, codec.model_id))
    assert load_sender(path, codec.receiver.config, codec.model_id).steps is not None
    path.write_bytes(serialise_sender(codec.sender, codec.model_id))
    assert load_sender(path, codec.receiver.config, codec.model_id).steps is None
    assert b"step_channels" not in path.read_bytes() and b"has_sharp_steps" not in path.read_bytes()
    assert SenderConfig().step_channels == 0


def parabola(y: Tensor) -> Objective:
    """The objective is the sum of squares, three quarters of which are D."""
    total = (y**2).sum()
    return Objective(0.75 * total, 0.25 * total, torch.full((1, 3, 16, 16), float(y.detach().mean())))


def test_proposals_get_unit_gradients_and_the_step_before_and_what_fails_is_undone() -> None:
    seen: list[tuple[Slope, Tensor, Tensor, float]] = []

    def propose(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
        seen.append((slope, y, previous, left))
        return -2.0 * slope.gradient

    start = torch.full((1, 1, 2, 2), 3.0)
    y = descend(start, parabola, 3, 0.5, propose)
    assert [round(left, 6) for *_, left in seen] == [1.0, 0.75, 0.5]
    first = seen[0][0]
    assert torch.equal(first.gradient, torch.ones_like(start)) and torch.equal(seen[0][2], torch.zeros_like(start))
    assert torch.equal(first.of_rate, 0.25 * first.gradient) and torch.equal(
        first.errors, torch.full((1, 3, 16, 16), 3.0)
    )
    assert torch.equal(seen[1][2], -2.0 * first.gradient)
    assert torch.allclose(y, start - 2 * 0.5 * (1.0 + 0.75 + 0.5))

    def uphill(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
        return slope.gradient

    # The second and third evaluations are worse than the start: both steps are undone, the last one is shorter.
    y = descend(start, parabola, 3, 0.5, uphill)
    assert torch.allclose(y, start + 0.5 / 4 * 0.5)


def test_what_the_network_sees_changes_its_steps(codec: Codec) -> None:
    network = StepNetwork(32, 128, 32)
    torch.nn.init.normal_(network.output.weight)
    condition = codec.receiver.condition(torch.tensor([100]), 2)
    maps = {name: torch.randn(1, 32, 4, 4) for name in ("gradient", "of_rate", "y", "previous")}
    inputs = maps | {
        "errors": torch.randn(1, 3, 32, 32),
        "features": torch.randn(1, 128, 8, 8),
        "state": torch.randn(1, 128, 1, 1),
    }

    @torch.no_grad()
    def step_for(**changed: Tensor) -> Tensor:
        given = inputs | changed
        known = network.prepare(given.pop("features"), given.pop("state"))
        step: Tensor = network(**given, left=0.5, known=known, condition=condition)
        return step

    plain = step_for()
    for name, value in inputs.items():
        assert not torch.allclose(step_for(**{name: value + 1.0}), plain), name
