"""Entropy coding of the latents of one stage to a payload, and back, as bitstream_spec/ENTROPY.md defines it.

`coding_order` has the order of the symbols, `priors` the table of each, `entropy.symbol_coders` the ANS coder. Without
torch, `runtime.decode` reads payloads in the same order, with exported graphs as the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int32
from torch import Tensor

from fecocodec.coding.coding_order import in_layout, scan_latents, split_partitions
from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.priors import EntropyParameters, LatentPrior, condition_vector
from fecocodec.coding.symbol_choice import PriceOfBits, choose_symbols, price_of_bits
from fecocodec.entropy.symbol_coders import SymbolCoder, SymbolReader, SymbolWriter, symbol_digest
from fecocodec.errors import InputError
from fecocodec.grid import LATENTS_PER_HYPERLATENT


@dataclass(frozen=True)
class CodedLatents:
    """Decoded latents of one stage, bit-identical at sender and receiver on every machine.

    symbols: one array for each of the seven batches: z, the three passes of the first step of y, its other three steps.
    y_hat, z_hat: dequantised values, multiples of 1/256.
    """

    symbols: tuple[Int32[np.ndarray, "..."], ...]
    y_hat: Float[Tensor, "view latent height_8 width_8"]
    z_hat: Float[Tensor, "view hyper height_32 width_32"]

    def digest(self) -> bytes:
        """Return the 8-byte digest of the symbols that the header stores."""
        return symbol_digest(self.symbols)


def encode_latents(
    prior: LatentPrior,
    y: Float[Tensor, "view latent height_8 width_8"],
    z: Float[Tensor, "view hyper height_32 width_32"],
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
    price: PriceOfBits = price_of_bits,
) -> tuple[bytes, CodedLatents]:
    """Code the latents of one stage; returns the payload and the latents that a receiver decodes from it.

    lambda_q: quantised lambda of the stage, `Header.lambda_q_of_stage`. stage: 1 or 2. context_y_hat: y_hat of stage 1
    when coding stage 2, else None. price: of a bit, for the choice of symbols; see `PriceOfBits`. Latents may have any
    magnitude; symbols are clamped to +-2^20. Raises InputError for NaN.
    """
    if bool(y.isnan().any() | z.isnan().any()):
        raise InputError(f"Stage {stage}: the latent holds NaN; check the images and the weights.")
    writer = SymbolWriter()
    size = (len(z), z.shape[2], z.shape[3])
    coded = code_latents(prior, writer, lambda_q, stage, context_y_hat, size, split_partitions(y, z), price)
    return writer.finish(), coded


def decode_latents(
    prior: LatentPrior,
    payload: bytes,
    size_8: tuple[int, int, int],
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
) -> CodedLatents:
    """Decode the latents of one stage.

    size_8: views, height and width of y; height and width are multiples of 4. Other arguments as for `encode_latents`.

    Raises BitstreamError for a payload that is not valid. A damaged payload can decode without an error, so the caller
    must compare `digest()` with the stored digest.
    """
    reader = SymbolReader(payload)
    size_32 = (size_8[0], size_8[1] // LATENTS_PER_HYPERLATENT, size_8[2] // LATENTS_PER_HYPERLATENT)
    coded = code_latents(prior, reader, lambda_q, stage, context_y_hat, size_32, wanted=None)
    reader.finish()
    return coded


@torch.no_grad()
def code_latents(
    prior: LatentPrior,
    coder: SymbolCoder,
    lambda_q: int,
    stage: int,
    context_y_hat: Float[Tensor, "view latent height_8 width_8"] | None,
    size_32: tuple[int, int, int],
    wanted: Sequence[Tensor] | None,
    price: PriceOfBits = price_of_bits,
) -> CodedLatents:
    """Code the latents in coding order, in exact arithmetic, with a symbol writer or reader.

    size_32: views, height and width of z. wanted: latents by partition (`split_partitions`) for a writer, None for a
    reader. price: used by a writer alone.
    """
    if (stage == 1) != (context_y_hat is None):
        raise ValueError(f"Stage {stage}: y_hat of the stage before belongs to stage 2, and to it only.")
    device = next(prior.parameters()).device
    symbols: list[np.ndarray] = []

    def exchange(partition: int, parameters: EntropyParameters) -> Tensor:
        table_index, sent = parameters.table_index(), None
        if wanted is not None:
            residual = wanted[partition].double() - parameters.mean_q8 / ONE_Q8
            chosen = choose_symbols(residual, table_index.double(), in_layout(price_of_item, partition))
            sent = chosen.to(torch.int32).cpu().numpy()
        symbols.append(coder.exchange(table_index.cpu().numpy(), sent))
        return torch.from_numpy(symbols[-1]).to(device, torch.float64) * ONE_Q8 + parameters.mean_q8

    views, *size = size_32
    lambdas = torch.full((views,), lambda_q, device=device)
    condition_q8, price_of_item = condition_vector(lambdas, stage).double(), price(lambdas, stage)
    context_q8 = None if context_y_hat is None else context_y_hat.to(device, torch.float64) * ONE_Q8
    latents = scan_latents(prior, condition_q8, (size[0], size[1]), context_q8, exchange)
    # Values below 2^16 in magnitude are exact in float32; only those of extreme symbols are rounded here.
    return CodedLatents(tuple(symbols), (latents.y_hat_q8 / ONE_Q8).float(), (latents.z_hat_q8 / ONE_Q8).float())
