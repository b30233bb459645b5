"""Entropy model of the latents: fixed-point networks that predict mean and scale of each element at both ends."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.coding.fixed_point import ONE_Q8, FixedPointLinear, saturate
from fecocodec.coding.quadtree import (
    KNOWN_BLOCKS,
    NUM_PHASES,
    NUM_STEPS,
    blocks_around,
    merge_passes,
    merge_phases,
    neighbourhoods,
    phase_neighbourhoods,
    split_passes,
)
from fecocodec.entropy.tables import NUM_TABLES, SIGMA_ONE_INDEX

NUM_STAGES = 2
LAMBDA_Q_CENTRE = 884  # of [0, 1768], the range of round(256 * ln(lambda / 1e-5)) for lambda up to 1e-2
NUM_CONDITIONS = 2 * NUM_STAGES
POSITIONS_PER_TABLE_Q8 = 32  # a network output of 1.0 (256 in Q8) is eight tables, so that outputs are of order 1


@dataclass(frozen=True)
class EntropyParameters:
    """Mean and scale of the distribution with which each element is coded.

    mean_q8: Q8; the decoded value is 256 symbol + mean_q8. position_q8: logarithmic scale of the distribution; 0 is the
    standard deviation 1, 256 is 2^(8/7), eight tables higher.
    """

    mean_q8: Float[Tensor, "*shape"]
    position_q8: Float[Tensor, "*shape"]

    def table_position(self) -> Float[Tensor, "*shape"]:
        """Return the index of the frequency table before rounding and clamping."""
        return self.position_q8 / POSITIONS_PER_TABLE_Q8 + SIGMA_ONE_INDEX

    def table_index(self) -> Int[Tensor, "*shape"]:
        """Return the index of the frequency table, in [0, 64)."""
        return (self.table_position() + 0.5).floor().clamp(0, NUM_TABLES - 1).long()


def condition_vector(lambda_q: Int[Tensor, " item"], stage: int) -> Float[Tensor, "item 4"]:
    """Return the condition of the networks in Q8: [1, centred ln(lambda)] in the entries of the stage, else zero.

    lambda_q: quantised lambda of the stage. stage: 1 or 2. The order is (stage 1, stage 2) of the ones, then of the
    logarithms.
    """
    condition = torch.zeros(len(lambda_q), NUM_CONDITIONS, device=lambda_q.device)
    condition[:, stage - 1] = ONE_Q8
    condition[:, NUM_STAGES + stage - 1] = lambda_q.to(condition.dtype) - LAMBDA_Q_CENTRE
    return condition


def _apply_rows(layer: FixedPointLinear, *inputs_q8: Float[Tensor, "... _"]) -> Float[Tensor, "... out"]:
    """Apply one layer at every position."""
    rows: Tensor = layer(*(x.reshape(1, -1, x.shape[-1]) for x in inputs_q8))
    return rows.view(*inputs_q8[0].shape[:-1], -1)


class BlockNetwork(nn.Module):
    """Entropy parameters of one pass of the first step, for blocks of 2x2 positions.

    [sum of the block's features | decoded neighbour blocks] -> 3/2 width -> ReLU -> width -> ReLU -> mean and position
    of a quarter of the channels at each of the four phases.
    """

    def __init__(self, num_known: int, quarter: int, width: int) -> None:
        super().__init__()
        self.enter = FixedPointLinear(width + num_known * NUM_PHASES * quarter, 3 * width // 2)
        self.middle = FixedPointLinear(3 * width // 2, width)
        self.leave = FixedPointLinear(width, NUM_PHASES * 2 * quarter, gain=0.1)

    def forward(self, *inputs_q8: Float[Tensor, "item row column _"]) -> EntropyParameters:
        x = torch.relu_(_apply_rows(self.enter, *inputs_q8))
        x = _apply_rows(self.leave, torch.relu_(_apply_rows(self.middle, x)))
        x = rearrange(x, "n i j (phase c) -> phase n i j c", phase=NUM_PHASES)
        mean_q8, position_q8 = x.chunk(2, dim=-1)
        return EntropyParameters(mean_q8, position_q8)


class ContextNetwork(nn.Module):
    """Entropy parameters of one of the steps after the first.

    [features | 3x3 neighbourhoods of the earlier steps] -> width -> ReLU -> width -> ReLU -> mean and position of a
    quarter of the channels. Each phase has its own weights, because each codes a different quarter.
    """

    def __init__(self, step: int, quarter: int, width: int) -> None:
        super().__init__()
        self.enter = FixedPointLinear(width + 9 * quarter * step, width, NUM_PHASES)
        self.middle = FixedPointLinear(width, width, NUM_PHASES)
        self.leave = FixedPointLinear(width, 2 * quarter, NUM_PHASES, gain=0.1)

    def forward(self, inputs_q8: Sequence[Float[Tensor, "4 item row column _"]]) -> EntropyParameters:
        x = torch.relu_(self.enter(*(part.flatten(1, 3) for part in inputs_q8)))
        x = self.leave(torch.relu_(self.middle(x)))
        mean_q8, position_q8 = x.unflatten(1, inputs_q8[0].shape[1:4]).chunk(2, dim=-1)
        return EntropyParameters(mean_q8, position_q8)


class LatentPrior(nn.Module):
    """Entropy model of hyper-latent z and latent y, shared by both stages (paper: h_s and context model).

    condition                              -> parameters of z
    z_hat, condition                       -> 3x3 at 1/32 -> upsample -> 3x3 at 1/16 -> upsample -> 1/8
    1/8, condition, y_hat of stage 1       -> features at 1/8
    features, decoded blocks of the step   -> BlockNetwork, three passes -> parameters of the first step of y
    features, decoded steps                -> ContextNetwork             -> parameters of each later step of y
    """

    def __init__(
        self, latent_channels: int = 32, hyper_channels: int = 16, width: int = 64, codes_stages_apart: bool = False
    ) -> None:
        """codes_stages_apart: whether zeros stand in for y_hat of stage 1."""
        super().__init__()
        self.latent_channels, self.hyper_channels = latent_channels, hyper_channels
        self.codes_stages_apart = codes_stages_apart
        self.hyper_prior = FixedPointLinear(NUM_CONDITIONS, 2 * hyper_channels, gain=0.1)
        self.enter = FixedPointLinear(NUM_CONDITIONS + 9 * hyper_channels, width)
        self.up_16 = FixedPointLinear(width, 4 * width)
        self.around_16 = FixedPointLinear(9 * width, width)
        self.up_8 = FixedPointLinear(width, 4 * width)
        self.merge_8 = FixedPointLinear(width + NUM_CONDITIONS + 9 * latent_channels, width)
        quarter = latent_channels // NUM_STEPS
        self.passes = nn.ModuleList(BlockNetwork(len(known), quarter, width) for known in KNOWN_BLOCKS)
        self.steps = nn.ModuleDict({str(step): ContextNetwork(step, quarter, width) for step in range(1, NUM_STEPS)})

    def hyper_parameters(
        self, condition_q8: Float[Tensor, "item 4"], height_32: int, width_32: int
    ) -> EntropyParameters:
        """Return the parameters of z, [item height/32 width/32 channel]; equal at all positions of an item."""
        parameters = _apply_rows(self.hyper_prior, condition_q8)[:, None, None].expand(-1, height_32, width_32, -1)
        mean_q8, position_q8 = parameters.chunk(2, dim=-1)
        return EntropyParameters(mean_q8, position_q8)

    def features(
        self,
        z_hat_q8: Float[Tensor, "item height_32 width_32 hyper"],
        condition_q8: Float[Tensor, "item 4"],
        context_q8: Float[Tensor, "item height_8 width_8 latent"] | None,
    ) -> Float[Tensor, "4 item row column width"]:
        """Return the features on which all parameters of y depend, by phase. context_q8: y_hat of stage 1, or None."""
        spread = condition_q8[:, None, None]
        x = neighbourhoods(saturate(z_hat_q8))
        x = torch.relu_(_apply_rows(self.enter, x, spread.expand(*x.shape[:3], -1)))
        x = torch.relu_(_apply_rows(self.up_16, x))
        x = merge_phases(rearrange(x, "n i j (phase c) -> phase n i j c", phase=NUM_PHASES))
        x = torch.relu_(_apply_rows(self.around_16, neighbourhoods(x)))
        x = torch.relu_(_apply_rows(self.up_8, x))
        x = rearrange(x, "n i j (phase c) -> phase n i j c", phase=NUM_PHASES)
        if context_q8 is not None and self.codes_stages_apart:
            context_q8 = 0 * context_q8
        around = [] if context_q8 is None else [phase_neighbourhoods(saturate(context_q8))]
        return torch.relu_(_apply_rows(self.merge_8, x, spread.expand(*x.shape[:-1], -1), *around))

    def block_parameters(
        self,
        features: Float[Tensor, "4 item row column width"],
        coded_q8: Sequence[Float[Tensor, "4 item _ _ quarter"]],
    ) -> EntropyParameters:
        """Return the parameters of the next pass of the first step, [4 item _ _ quarter].

        coded_q8: values of the passes decoded so far, in the same layout.
        """
        number = len(coded_q8)
        inputs = [saturate(features.sum(dim=0))]
        if coded_q8:
            blocks = rearrange(saturate(merge_passes(coded_q8)), "phase n i j c -> n i j (phase c)")
            inputs.append(blocks_around(blocks, KNOWN_BLOCKS[number]))
        parameters: EntropyParameters = self.passes[number](*(split_passes(x)[number] for x in inputs))
        return parameters

    def surroundings(
        self, y_hat_q8: Float[Tensor, "4 item row column quarter"]
    ) -> Float[Tensor, "4 item row column _"]:
        """Return the 3x3 neighbourhoods of one decoded step, an input of the later steps."""
        return phase_neighbourhoods(merge_phases(saturate(y_hat_q8)))
