"""Latents <-> payload: the walk with a port in the place where symbols are exchanged."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int32
from torch import Tensor

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.priors import EntropyParameters, LatentPrior, condition_vector
from fecocodec.coding.symbol_choice import choose_symbols, price_of_bits
from fecocodec.coding.walk import FACTOR_32, in_layout, split_partitions, walk_latents
from fecocodec.entropy.digest import symbol_digest
from fecocodec.entropy.symbol_coders import SymbolCoder, SymbolReader, SymbolWriter
from fecocodec.errors import InputError


@dataclass(frozen=True)
class CodedLatents:
    """What both ends know after a payload: exactly the same on every machine.

    symbols: z, then the passes and steps of y, each in coding order. y_hat, z_hat: values after coding, multiples of
    1/256.
    """

    symbols: tuple[Int32[np.ndarray, "..."], ...]
    y_hat: Float[Tensor, "view latent height_8 width_8"]
    z_hat: Float[Tensor, "view hyper height_32 width_32"]

    def digest(self) -> bytes:
        """8 bytes over the symbols, for the header."""
        return symbol_digest(self.symbols)


def encode_latents(
    prior: LatentPrior,
    y: Float[Tensor, "view latent height_8 width_8"],
    z: Float[Tensor, "view hyper height_32 width_32"],
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
) -> tuple[bytes, CodedLatents]:
    """Payload of one stage (1 or 2), and what a receiver will have of it.

    lambda_q: round(256 ln(lambda / 1e-5)) in [0, 1768]. context_y_hat: in stage 2 y_hat of stage 1, else None. Any
    latent can be coded, however large; raises InputError for NaN.
    """
    if bool(y.isnan().any() | z.isnan().any()):
        raise InputError(f"Stage {stage}: the latent holds NaN; check the images and the weights.")
    writer = SymbolWriter()
    size = (len(z), z.shape[2], z.shape[3])
    coded = code_latents(prior, writer, lambda_q, stage, context_y_hat, size, split_partitions(y, z))
    return writer.finish(), coded


def decode_latents(
    prior: LatentPrior,
    payload: bytes,
    size_8: tuple[int, int, int],
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
) -> CodedLatents:
    """Latents of one stage. size_8: views, height and width of y; the latter two are multiples of 4.

    Raises BitstreamError for a damaged payload; damage that a payload itself does not show is found by comparing
    `digest()` with the one that was stored.
    """
    reader = SymbolReader(payload)
    size_32 = (size_8[0], size_8[1] // FACTOR_32, size_8[2] // FACTOR_32)
    coded = code_latents(prior, reader, lambda_q, stage, context_y_hat, size_32, wanted=None)
    reader.finish()
    return coded


@torch.no_grad()
def code_latents(
    prior: LatentPrior,
    port: SymbolCoder,
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
    size_32: tuple[int, int, int],
    wanted: Sequence[Tensor] | None,
) -> CodedLatents:
    """The walk in exact arithmetic with either port. wanted: latents by partition (`split_partitions`) for a writer."""
    if (stage == 1) != (context_y_hat is None):
        raise ValueError(f"Stage {stage}: y_hat of the stage before belongs to stage 2, and to it only.")
    device = next(prior.parameters()).device
    symbols: list[np.ndarray] = []

    def exchange(partition: int, parameters: EntropyParameters) -> Tensor:
        table_index, sent = parameters.table_index(), None
        if wanted is not None:
            residual = wanted[partition].double() - parameters.mean_q8 / ONE_Q8
            chosen = choose_symbols(residual, table_index.double(), in_layout(price, partition))
            sent = chosen.to(torch.int32).cpu().numpy()
        symbols.append(port.exchange(table_index.cpu().numpy(), sent))
        return torch.from_numpy(symbols[-1]).to(device, torch.float64) * ONE_Q8 + parameters.mean_q8

    views, *size = size_32
    lambdas = torch.full((views,), lambda_q, device=device)
    condition_q8, price = condition_vector(lambdas, stage).double(), price_of_bits(lambdas, stage)
    context_q8 = None if context_y_hat is None else context_y_hat.to(device, torch.float64) * ONE_Q8
    walked = walk_latents(prior, condition_q8, (size[0], size[1]), context_q8, exchange)
    # Where a symbol is extreme a value has more bits than float32; only such are rounded here.
    return CodedLatents(tuple(symbols), (walked.y_hat_q8 / ONE_Q8).float(), (walked.z_hat_q8 / ONE_Q8).float())
