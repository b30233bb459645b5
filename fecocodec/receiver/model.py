"""The receiver's networks, and their weights file."""

from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.checkpoint import config_of, load_into, read_weights, serialise_weights
from fecocodec.coding.fixed_point import export_integers, load_integers
from fecocodec.coding.priors import LatentPrior
from fecocodec.config import METHODS, PAPER, ReceiverConfig, stored_fields
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.grid import PER_BLOCK
from fecocodec.layers.blocks import BlockChain, RateCondition, RateEmbedding, upsample
from fecocodec.receiver.predictor import Predictor
from fecocodec.receiver.state import Features, Latents, StateUpdate
from fecocodec.splatting.attributes import RAW
from fecocodec.splatting.emission import Prediction

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


class Synthesis(nn.Module):
    """y_hat (1/8) -> 3x3 conv -> 2D blocks at 1/8 -> upsample -> features (1/4).

    There is no block at 1/4, because the state update has one and a second one is slow.
    """

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        width = config.synthesis_channels
        self.input = nn.Conv2d(config.latent_channels, width, 3, padding=1)
        self.coarse = BlockChain(width, width, config.synthesis_depth)
        self.up = upsample(width, config.state_channels)

    def forward(self, y_hat: Latents, condition: RateCondition) -> Features:
        return self.up(self.coarse(self.input(y_hat / condition.latent_gain), condition))


class Receiver(nn.Module):
    """Receiver: payload -> entropy model -> y_hat -> g_s -> U -> S, per stage; then S, cameras -> P -> Gaussians.

    Both stages share all networks. `splatting.emission.emit` turns the output of P into Gaussians.
    """

    def __init__(self, config: ReceiverConfig) -> None:
        """Raises ModelError for a configuration that does not exist."""
        super().__init__()
        _check(config)
        self.config = config
        self.prior = LatentPrior(
            config.latent_channels, config.hyper_channels, config.prior_channels, config.codes_stages_apart
        )
        self.embedding = RateEmbedding(LAMBDA_Q_MAX, config.largest_gain, config.gain_exponent)
        self.synthesis = Synthesis(config)
        self.update = StateUpdate(config)
        self.predictor = Predictor(config)
        self.detail = DetailBasis(config) if config.detail_planes else None

    def condition(self, lambda_q: Int[Tensor, " item"], stage: int) -> RateCondition:
        """Return the condition of the 2D blocks, per item, in stage 1 or 2."""
        return self.embedding(lambda_q, stage)

    def next_state(
        self, state: Float[Tensor, "item channel _ _"], y_hat: Latents, condition: RateCondition
    ) -> Features:
        """S_k = U(concat(S_{k-1}, g_s(y_hat_k))) (paper, stage I and stage II)."""
        return self.update(state, self.synthesis(y_hat, condition), condition)

    def predict(
        self,
        state: Features,
        cameras: Cameras,
        condition: RateCondition,
        detail: Float[Tensor, "item plane h8 w8"] | None = None,
    ) -> Prediction:
        """G_k = P(S_k, cameras). cameras: normalised, with one batch dimension. detail: see `DetailBasis`.

        Raises ModelError for detail if the model has none.
        """
        return self.predictor(state, cameras, condition, None if detail is None else self.detail_basis(detail))

    @property
    def detail_basis(self) -> DetailBasis:
        """Raises ModelError if the model has no detail layer."""
        if self.detail is None:
            raise ModelError("the model has no detail layer, but the stream has one; use the model that wrote it.")
        return self.detail


def _check(config: ReceiverConfig) -> None:
    if config.method not in METHODS:
        raise ModelError(f"There is no method '{config.method}'; choose {' or '.join(METHODS)}.")
    if config.gaussians_per_side not in config.kind.gaussians_per_side:
        raise ModelError(
            f"{config.gaussians_per_side} Gaussians a side of a cell with the method '{config.method}' are not "
            f"supported; choose 2, or 1 or 4 with the method '{PAPER}'."
        )
    if config.sh_degree > config.kind.max_sh_degree:
        raise ModelError(
            f"Predicted harmonics of degree {config.sh_degree} are not supported with the method '{config.method}'; "
            f"choose at most {config.kind.max_sh_degree}."
        )
    if config.detail_planes and not config.kind.has_steps:
        raise ModelError(f"The method '{PAPER}' has no detail layer; set detail_planes to 0.")


PRIOR = "prior."


def load_receiver(path: Path) -> tuple[Receiver, bytes]:
    """Return the receiver in evaluation mode, without gradients, and its model id.

    Raises ModelError if the file is missing, damaged, or not a receiver of this version.
    """
    weights = read_weights(path)
    receiver = Receiver(config_of(weights, "receiver", ReceiverConfig(), path))
    integers = {name.removeprefix(PRIOR): value for name, value in weights.tensors.items() if name.startswith(PRIOR)}
    load_integers(receiver.prior, integers)
    floats = {name: value for name, value in weights.tensors.items() if not name.startswith(PRIOR)}
    floats |= {name: value for name, value in receiver.state_dict().items() if name.startswith(PRIOR)}
    load_into(receiver, floats, path)
    return receiver.eval().requires_grad_(False), weights.model_id


def serialise_receiver(receiver: Receiver) -> bytes:
    """Return the bytes of the receiver's weights file: integers for the entropy model, fp16 for all else."""
    integers = {PRIOR + name: value for name, value in export_integers(receiver.prior).items()}
    floats = {name: value for name, value in receiver.state_dict().items() if not name.startswith(PRIOR)}
    return serialise_weights(floats | integers, {"receiver": stored_fields(receiver.config)})
