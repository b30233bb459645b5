"""Linear layers in fixed-point arithmetic, shared by training and coding.

Activations are Q8 integers (256 represents 1.0) in floating-point tensors, weights are Q12, biases Q20. In float64
every product and sum is a multiple of 2^-12 far below 2^41, hence exact in any order of summation. The result equals
integer arithmetic on every device, for any number of threads and any vector width (ENTROPY.md, section 5). In float32,
which training uses, the same code differs only by the rounding of sums. The dtype of the input selects the precision.
"""

import math
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.errors import ModelError

ONE_Q8 = 256
ACTIVATION_LOWEST, ACTIVATION_HIGHEST = -(1 << 15), (1 << 15) - 1
WEIGHT_BITS, WEIGHT_LIMIT = 12, (1 << 15) - 1
BIAS_BITS, BIAS_LIMIT = 20, 1 << 24  # integers up to 2^24 are exact in float32, the dtype of the parameters
MAX_INPUTS = 1 << 20  # |accumulator| <= MAX_INPUTS * 2^30 + 2^24 < 2^53


class _FloorThrough(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, lowest: int, highest: int) -> Tensor:
        return torch.floor(x).clamp_(lowest, highest)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        return grad, None, None


class _ClampThrough(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, lowest: int, highest: int) -> Tensor:
        ctx.save_for_backward(x)
        ctx.limits = lowest, highest
        return x.clamp(lowest, highest)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        (x,) = ctx.saved_tensors
        lowest, highest = ctx.limits
        outwards = ((x < lowest) & (grad > 0)) | ((x > highest) & (grad < 0))
        return grad.masked_fill(outwards, 0.0), None, None


def round_through(x: Float[Tensor, "*shape"], lowest: int, highest: int) -> Float[Tensor, "*shape"]:
    """Return floor(x + 1/2), clamped to [lowest, highest], with a straight-through gradient, also where clamped."""
    return _floor_through(x + 0.5, lowest, highest)


def _floor_through(x: Tensor, lowest: int, highest: int) -> Tensor:
    if not torch.is_grad_enabled():  # avoid the overhead of autograd when coding
        return torch.floor(x).clamp_(lowest, highest)
    result: Tensor = _FloorThrough.apply(x, lowest, highest)
    return result


def clamp_through(x: Float[Tensor, "*shape"], lowest: int, highest: int) -> Float[Tensor, "*shape"]:
    """Clamp x to [lowest, highest].

    A clamped value keeps gradients whose descent step moves it back into the range; others become 0.
    """
    result: Tensor = _ClampThrough.apply(x, lowest, highest)
    return result


def saturate(x_q8: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Clamp Q8 values to int16, the range of a layer's input."""
    return x_q8.clamp(ACTIVATION_LOWEST, ACTIVATION_HIGHEST)


class FixedPointLinear(nn.Module):
    """Fixed-point linear layer: inputs [group row in] -> concat @ weight + bias -> round to Q8 -> clamp to int16.

    Every group has its own matrix. The inputs are concatenated along the last dimension; missing trailing inputs count
    as zero. Parameters are real numbers; their integers are weight * 2^12 (int16) and bias * 2^20 (int32), rounded half
    up.
    """

    def __init__(self, num_inputs: int, num_outputs: int, num_groups: int = 1, gain: float = math.sqrt(2.0)) -> None:
        super().__init__()
        if num_inputs > MAX_INPUTS:
            raise ModelError(f"Layer with {num_inputs} inputs: sums are exact up to {MAX_INPUTS}; use fewer inputs.")
        self.weight = nn.Parameter(torch.randn(num_groups, num_inputs, num_outputs) * (gain / math.sqrt(num_inputs)))
        self.bias = nn.Parameter(torch.zeros(num_groups, num_outputs))
        self._kept: tuple[tuple[object, ...], tuple[Tensor, Tensor]] | None = None

    def rounded_weight(self) -> Float[Tensor, "group in out"]:
        """Return the weight as Q12 integers, in floats."""
        return round_through(self.weight * (1 << WEIGHT_BITS), -WEIGHT_LIMIT, WEIGHT_LIMIT)

    def rounded_bias(self) -> Float[Tensor, "group out"]:
        """Return the bias as Q20 integers, in float64, because float32 cannot represent 2^24 + 1/2 during rounding."""
        return round_through(self.bias.double() * (1 << BIAS_BITS), -BIAS_LIMIT, BIAS_LIMIT)

    def forward(self, *inputs_q8: Float[Tensor, "group row _"]) -> Float[Tensor, "group row out"]:
        weight, sums = self._weight_and_start(inputs_q8[0].dtype)
        widths = [x.shape[-1] for x in inputs_q8]
        rows = weight.split([*widths, weight.shape[1] - sum(widths)], dim=1)
        for x_q8, part in zip(inputs_q8, rows[:-1], strict=True):
            sums = torch.baddbmm(sums, x_q8, part)
        return _floor_through(sums, ACTIVATION_LOWEST, ACTIVATION_HIGHEST)

    def _weight_and_start(self, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        """Return the rounded weight and the start of the sums: bias + 1/2, so that floor rounds to nearest.

        They are cached for weights without gradients, because rounding would take a tenth of the decoding time.
        """
        if self.weight.requires_grad:
            return self._rounded_terms(dtype)
        key = (dtype, *((p.device, p.data_ptr(), p._version) for p in (self.weight, self.bias)))
        if self._kept is None or self._kept[0] != key:
            with torch.inference_mode(False), torch.no_grad():
                self._kept = (key, self._rounded_terms(dtype))
        return self._kept[1]

    def _rounded_terms(self, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        weight = (self.rounded_weight() / (1 << WEIGHT_BITS)).to(dtype)
        half = 0.5  # added to the bias, because adding it to the sums would take another pass over the activations
        return weight, (self.rounded_bias() / (1 << (BIAS_BITS - 8)) + half).to(dtype)[:, None]


def export_integers(module: nn.Module) -> dict[str, Int[Tensor, "..."]]:
    """Return weights (int16, Q12) and biases (int32, Q20) of all fixed-point layers, named as in `named_modules`."""
    integers = {}
    for name, layer in module.named_modules():
        if isinstance(layer, FixedPointLinear):
            integers[f"{name}.weight"] = layer.rounded_weight().detach().to(torch.int16)
            integers[f"{name}.bias"] = layer.rounded_bias().detach().to(torch.int32)
    return integers


def load_integers(module: nn.Module, integers: dict[str, Int[Tensor, "..."]]) -> None:
    """Set all fixed-point layers from exported integers. Raises ModelError for a wrong name, shape, dtype or range."""
    expected = export_integers(module)
    if expected.keys() != integers.keys():
        name = sorted(expected.keys() ^ integers.keys())[0]
        raise ModelError(f"Entropy model: tensor '{name}' is missing or unknown; use weights made by this version.")
    for name, like in expected.items():
        _check_integers(name, integers[name], like)
    with torch.no_grad():
        for name, parameter in module.named_parameters():
            bits = WEIGHT_BITS if name.endswith("weight") else BIAS_BITS
            parameter.copy_(integers[name].to(parameter.dtype) / (1 << bits))


def _check_integers(name: str, found: Tensor, like: Tensor) -> None:
    if found.shape != like.shape or found.dtype != like.dtype:
        raise ModelError(
            f"Entropy model: tensor '{name}' is {found.dtype} {list(found.shape)}, expected {like.dtype} "
            f"{list(like.shape)}; use weights made by this version."
        )
    limit = WEIGHT_LIMIT if like.dtype == torch.int16 else BIAS_LIMIT
    largest = int(found.long().abs().max())
    if largest > limit:
        raise ModelError(
            f"Entropy model: tensor '{name}' reaches {largest}, the limit is {limit}; the file is damaged."
        )
