"""Detail: numbers of the stream that change the raw outputs of the predictor's head directly, by a fixed basis."""

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.grid import PER_BLOCK
from fecocodec.splatting.attributes import RAW

NUM_BUCKETS = 16  # of the context that chooses the table of a symbol (ENTROPY.md)


class DetailBasis(nn.Module):
    """Numbers of each block of 8x8 pixels -> raw outputs of the head for its 4x4 Gaussians, to be added.

    basis: raw outputs of a block, ordered (row, column, output), for the number 1 of each plane. tables: frequency
    table of a symbol, by plane and context.
    """

    tables: Tensor

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        planes, raw = config.detail_planes, sum(RAW.values())
        self.basis = nn.Parameter(0.1 * torch.randn(planes, PER_BLOCK**2 * raw) / (PER_BLOCK**2 * raw) ** 0.5)
        self.register_buffer("tables", torch.full((planes, NUM_BUCKETS), 22, dtype=torch.uint8))

    def forward(self, values: Float[Tensor, "item plane h8 w8"]) -> Float[Tensor, "item raw h2 w2"]:
        """Return what is added to the raw outputs. values: symbols times their step."""
        blocks = torch.einsum("ikhw,kr->irhw", values, self.basis)
        return rearrange(blocks, "i (p q c) h w -> i c (h p) (w q)", p=PER_BLOCK, q=PER_BLOCK)
