"""Fixed-point layers equal integer arithmetic in float64, and approximate it in float32."""

import numpy as np
import pytest
import torch

from fecocodec.coding.fixed_point import (
    FixedPointLinear,
    clamp_through,
    export_integers,
    load_integers,
    round_through,
)
from fecocodec.errors import ModelError


def integer_layer(layer: FixedPointLinear, x: np.ndarray) -> np.ndarray:
    integers = export_integers(torch.nn.ModuleDict({"layer": layer}))
    weight, bias = integers["layer.weight"].long().numpy(), integers["layer.bias"].long().numpy()
    return np.clip((x @ weight + bias[:, None] + 2048) >> 12, -32768, 32767)


@pytest.mark.parametrize("weight_scale", [0.05, 1.0, 20.0])
def test_float64_is_integer_arithmetic(weight_scale: float):
    """Includes extreme activations, and weights beyond their range."""
    torch.manual_seed(0)
    layer = FixedPointLinear(360, 24, num_groups=4)
    layer.weight.data.normal_(0, weight_scale)
    layer.bias.data.normal_(0, 10.0)
    x = torch.randint(-32768, 32768, (4, 50, 360))
    x[:, :5] = 32767
    assert np.array_equal(layer(x.double()).detach().long().numpy(), integer_layer(layer, x.numpy()))


def test_inputs_side_by_side_and_inputs_not_given():
    torch.manual_seed(1)
    layer = FixedPointLinear(20, 5, num_groups=2)
    x = torch.randint(-500, 500, (2, 7, 20)).double()
    assert torch.equal(layer(x[..., :3], x[..., 3:]), layer(x))
    x[..., 12:] = 0
    assert torch.equal(layer(x[..., :12]), layer(x))


def test_float32_differs_from_integers_by_rounding_only():
    torch.manual_seed(2)
    layer = FixedPointLinear(288, 64)
    x = torch.randint(-2000, 2000, (1, 500, 288))
    difference = (layer(x.float()).double() - layer(x.double())).abs()
    assert difference.max() <= 1.0
    assert (difference > 0).double().mean() < 0.01


def test_gradients_pass_straight_through():
    x = torch.tensor([-40000.0, -0.6, 0.4, 40000.0], requires_grad=True)
    round_through(x, -32768, 32767).backward(torch.arange(4.0))
    assert x.grad is not None and x.grad.tolist() == [0.0, 1.0, 2.0, 3.0]
    x = torch.tensor([-1.0, -1.0, 5.0, 12.0, 12.0], requires_grad=True)
    clamp_through(x, 0, 10).backward(torch.tensor([1.0, -1.0, 1.0, 1.0, -1.0]))
    assert x.grad is not None and x.grad.tolist() == [0.0, -1.0, 1.0, 1.0, 0.0]


def test_export_and_load_are_inverse():
    torch.manual_seed(3)
    source = torch.nn.ModuleDict({"a": FixedPointLinear(9, 4), "b": FixedPointLinear(4, 2, num_groups=4)})
    source["a"].bias.data = torch.tensor([[(2**23 + 1) / 2**20, 30.0, -15.999999, -0.1]])
    integers = export_integers(source)
    target = torch.nn.ModuleDict({"a": FixedPointLinear(9, 4), "b": FixedPointLinear(4, 2, num_groups=4)})
    load_integers(target, integers)
    again = export_integers(target)
    assert integers.keys() == again.keys()
    assert all(torch.equal(again[name], tensor) for name, tensor in integers.items())
    assert integers["a.bias"][0, :2].tolist() == [2**23 + 1, 2**24]
    assert integers["a.weight"].dtype == torch.int16 and integers["a.bias"].dtype == torch.int32
    x = torch.randint(-500, 500, (1, 7, 9)).double()
    assert torch.equal(target["a"](x), source["a"](x))


def test_integers_that_do_not_fit_are_refused():
    module = torch.nn.ModuleDict({"a": FixedPointLinear(3, 2)})
    integers = export_integers(module)
    with pytest.raises(ModelError, match=r"'a\.weight' is missing or unknown"):
        load_integers(module, {"a.bias": integers["a.bias"]})
    with pytest.raises(ModelError, match=r"'a\.weight' is torch\.int32"):
        load_integers(module, {**integers, "a.weight": integers["a.weight"].int()})
    with pytest.raises(ModelError, match=r"'a\.bias' reaches 16777217, the limit is 16777216"):
        load_integers(module, {**integers, "a.bias": torch.full((1, 2), (1 << 24) + 1, dtype=torch.int32)})
    with pytest.raises(ModelError, match="sums are exact"):
        FixedPointLinear((1 << 20) + 1, 1)
