"""Initialisation of training as a linear block-transform codec.

Random networks need thousands of steps to learn to transmit colour from photographs to Gaussians
(docs/what_we_learned.md). Here reserved channels of every residual chain transmit pixels and matched disparity as 8x8
DCT coefficients to the colours and depths of the Gaussians. All other weights start at random and add to these
channels.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from fecocodec.grid import PER_CELL
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import PictureFeedbackExtractor, Sender
from fecocodec.splatting.attributes import RAW

PIXELS = 48  # of a 4x4 cell: (colour, row, column), as pixel unshuffle orders them
DISPARITY = PIXELS  # the channel after the pixels, in [-1, 1]
CELL_CHANNELS = PIXELS + 1
IN_CELL = PER_CELL**2
COLOURS = 3 * IN_CELL  # of a cell's Gaussians: (colour, row, column)
STATE_CHANNELS = COLOURS + 1  # then disparity
LUMA_FREQUENCIES = tuple((u, v) for u in range(4) for v in range(4))  # all that half the resolution can represent
CHROMA_FREQUENCIES = ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (2, 0))
LUMA = (1 / math.sqrt(3), 1 / math.sqrt(3), 1 / math.sqrt(3))
CHROMA = ((1 / math.sqrt(2), 0.0, -1 / math.sqrt(2)), (1 / math.sqrt(6), -2 / math.sqrt(6), 1 / math.sqrt(6)))
COLOUR_SCALE = 1.5  # quantisation step at lambda 1e-4: about 0.07 of an orthonormal coefficient of colours in [0, 1]
DISPARITY_SCALE = 6.0
DEPTH_SLOPE = 2.0  # sigmoid(2 d) lies near (1 + d) / 2
COLOUR_SLOPE = 1.1  # likewise for colours, with some sharpening against the blur of Gaussians
OPACITY, LOG_SCALE = 0.5, -0.15  # opacity 0.92 and scale 0.58 cells, the sharpest of those tried


@torch.no_grad()
def start_as_block_transform(sender: Sender, receiver: Receiver) -> None:
    """Overwrite, in place, the weights of the reserved channels of all networks between photographs and Gaussians."""
    _start_sender(sender)
    _start_receiver(receiver)


def _start_sender(sender: Sender) -> None:
    extractor, analysis, feedback = sender.extractor, sender.analysis, sender.feedback
    first_pixel = extractor.input.in_channels - PIXELS
    disparity = first_pixel - 2  # then confidence, then pixels
    _set_only(extractor.input, [*((c, first_pixel + c, 1.0) for c in range(PIXELS)), (DISPARITY, disparity, 1.0)])
    for block in (extractor.fine_in, extractor.fine_out):
        _set_identity(block, CELL_CHANNELS)
    _set_zero(extractor.up_middle[0], 4 * CELL_CHANNELS)
    _set_only(extractor.output, _identity(CELL_CHANNELS))

    if isinstance(feedback, PictureFeedbackExtractor):  # half of 4 (I - I1_hat), of inputs 2 I - 1 and 2 I1_hat - 1
        entries = [entry for c in range(PIXELS) for entry in ((c, c, 1.0), (c, PIXELS + c, -1.0))]
    else:
        entries = [(c, PIXELS + c, 0.5) for c in range(PIXELS)]
    _set_only(feedback.input, entries)
    _set_zero(feedback.input, CELL_CHANNELS, first=PIXELS)
    for block in feedback.blocks:
        _set_identity(block, CELL_CHANNELS)

    _set_only(analysis.join, _identity(CELL_CHANNELS))
    _set_identity(analysis.fine, CELL_CHANNELS)
    forward = forward_transform()
    _set_zero(analysis.down, len(forward))
    analysis.down.weight[: len(forward), :CELL_CHANNELS] = forward
    for block in analysis.coarse:
        _set_identity(block, len(forward))
    _set_only(analysis.output, [(k, k, scale) for k, scale in enumerate(_scales())])


def _start_receiver(receiver: Receiver) -> None:
    synthesis, update, predictor = receiver.synthesis, receiver.update, receiver.predictor
    inverse = inverse_transform()
    num_coefficients = inverse.shape[-1]
    _set_only(synthesis.input, [(k, k, 1.0 / scale) for k, scale in enumerate(_scales())])
    for block in synthesis.coarse:
        _set_identity(block, num_coefficients)
    _set_zero(synthesis.up[0], 4 * STATE_CHANNELS)
    synthesis.up[0].get_parameter("weight")[: 4 * STATE_CHANNELS, :num_coefficients, 0, 0] = inverse.flatten(0, 1)

    channels = update.join.out_channels
    _set_only(update.join, [entry for c in range(STATE_CHANNELS) for entry in ((c, c, 1.0), (c, channels + c, 1.0))])
    _set_identity(update.block, STATE_CHANNELS)
    update.initial_state[:, :STATE_CHANNELS] = 0.0

    _set_zero(predictor.up_middle[0], 4 * STATE_CHANNELS)
    _set_identity(predictor.fine, STATE_CHANNELS)
    _set_zero(predictor.attention.output, STATE_CHANNELS)
    predictor.depth_head.weight *= 0.1
    predictor.depth_head.weight[0, COLOURS, 1, 1] = DEPTH_SLOPE
    predictor.depth_head.get_parameter("bias").zero_()
    _start_head(predictor.head[0], predictor.head[2], receiver.config.gaussians_per_side)


def _start_head(first: nn.Module, last: nn.Module, per_side: int) -> None:
    """Transmit colours through the GELU unchanged, because gelu(x) - gelu(-x) = x.

    per_side: rows and columns of a cell's Gaussians. Other numbers than two get the four colours averaged or repeated.
    """
    _set_only(first, [entry for c in range(COLOURS) for entry in ((c, c, 1.0), (COLOURS + c, c, -1.0))])
    num = per_side**2
    order = list(RAW)
    offset = {name: num * sum(RAW[n] for n in order[: order.index(name)]) for name in order}
    weight, bias = last.get_parameter("weight"), last.get_parameter("bias")
    resampling = F.interpolate(torch.eye(IN_CELL).view(IN_CELL, 1, 2, 2), (per_side, per_side), mode="area")
    slopes = COLOUR_SLOPE * resampling.flatten(1).T  # [Gaussian, colour of the cell]
    for colour in range(3):
        rows = slice(offset["colour"] + num * colour, offset["colour"] + num * (colour + 1))
        weight[rows, : 2 * COLOURS] = 0.0
        for sign, begin in ((1.0, IN_CELL * colour), (-1.0, COLOURS + IN_CELL * colour)):
            weight[rows, begin : begin + IN_CELL, 0, 0] = sign * slopes
    for name, value in (("opacity", OPACITY), ("scale", LOG_SCALE)):
        bias[offset[name] : offset[name] + num * RAW[name]] = value


def forward_transform() -> Tensor:
    """Return weights [coefficient, channel, 2, 2] of the convolution from 1/4 to 1/8: pixels and disparity to DCT."""
    dct = _dct_basis()
    rows = []
    for colour, (u, v) in _colour_coefficients():
        pattern = torch.outer(dct[u], dct[v]).view(2, 4, 2, 4).permute(1, 3, 0, 2)  # [row column 2 2]
        coefficient = torch.einsum("c,yxij->cyxij", torch.tensor(colour), pattern).flatten(0, 2)
        rows.append(torch.cat((coefficient, torch.zeros(1, 2, 2))))
    rows += [torch.cat((torch.zeros(PIXELS, 2, 2), pattern[None])) for pattern in _disparity_patterns()]
    return torch.stack(rows)


def inverse_transform() -> Tensor:
    """Return weights [channel, 4, coefficient]: DCT to half-resolution colours and disparity of 4 cells."""
    dct = _dct_basis().view(8, 2, 2, 2).mean(dim=-1)  # [frequency, cell, Gaussian of the cell]
    columns = []
    for colour, (u, v) in _colour_coefficients():
        pattern = torch.einsum("c,ig,jh->cghij", torch.tensor(colour), dct[u], dct[v])
        columns.append(torch.cat((pattern.flatten(0, 2).flatten(1), torch.zeros(1, 4))))
    columns += [torch.cat((torch.zeros(COLOURS, 4), pattern.flatten()[None])) for pattern in _disparity_patterns()]
    return torch.stack(columns, dim=-1)


def _colour_coefficients() -> list[tuple[tuple[float, float, float], tuple[int, int]]]:
    """Return (orthonormal colour axis, frequency) of each coefficient: luma, then two chromas."""
    chroma = [(axis, frequency) for axis in CHROMA for frequency in CHROMA_FREQUENCIES]
    return [(LUMA, frequency) for frequency in LUMA_FREQUENCIES] + chroma


def _dct_basis() -> Tensor:
    """Return the orthonormal DCT-II of eight samples: [frequency, sample]."""
    frequency, sample = torch.arange(8.0)[:, None], torch.arange(8.0)[None]
    basis = 0.5 * torch.cos(math.pi * frequency * (2 * sample + 1) / 16)
    basis[0] = 1 / math.sqrt(8)
    return basis


def _disparity_patterns() -> list[Tensor]:
    """Return the orthonormal Haar patterns of the four cells of a block."""
    sign = torch.tensor([1.0, -1.0])
    one = torch.ones(2)
    return [0.5 * torch.outer(a, b) for a in (one, sign) for b in (one, sign)]


def _scales() -> list[float]:
    return [COLOUR_SCALE] * len(_colour_coefficients()) + [DISPARITY_SCALE] * 4


def _identity(num_channels: int) -> list[tuple[int, int, float]]:
    return [(c, c, 1.0) for c in range(num_channels)]


def _set_only(convolution: nn.Module, entries: list[tuple[int, int, float]]) -> None:
    """Set each output named in `entries` (output, input, weight at the centre) to these inputs alone."""
    for output in {output for output, _, _ in entries}:
        _set_zero(convolution, output + 1, first=output)
    weight = convolution.get_parameter("weight")
    row, column = (side // 2 for side in weight.shape[-2:])
    for output, source, value in entries:
        weight[output, source, row, column] = value


def _set_zero(layer: nn.Module, last: int, first: int = 0) -> None:
    """Set weights and biases of the outputs in [first, last) to zero."""
    layer.get_parameter("weight")[first:last] = 0.0
    layer.get_parameter("bias")[first:last] = 0.0


def _set_identity(block: nn.Module, num_channels: int) -> None:
    """Make a residual block the identity on the first channels."""
    _set_zero(block.get_submodule("pointwise"), num_channels)
