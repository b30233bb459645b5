"""The entropy model of the test vectors, with detail: small, with random fixed numbers, stored beside the vectors.

`python -m tests.vectors.tiny_model` draws it again, which is necessary only after a change of the architecture.
"""

import math
from functools import cache
from pathlib import Path
from random import Random

import torch
from safetensors.torch import load
from torch import Tensor

from fecocodec.checkpoint import model_id_of, serialise_weights
from fecocodec.coding.fixed_point import export_integers, load_integers
from fecocodec.coding.priors import LatentPrior
from fecocodec.grid import PER_BLOCK
from fecocodec.receiver.model import NUM_BUCKETS
from fecocodec.splatting.attributes import RAW

VECTORS = Path(__file__).resolve().parents[2] / "bitstream_spec" / "vectors"
TINY_MODEL = VECTORS / "tiny.safetensors"
LATENT_CHANNELS, HYPER_CHANNELS, WIDTH, DETAIL_PLANES = 8, 4, 8, 8


def make_tiny_model() -> bytes:
    """Return a weights file with widely varying table indices. The stored file is normative, not this function."""
    random = Random(20261121)
    integers = export_integers(empty_prior())
    made = {f"prior.{name}": random_like(name, integers[name], random) for name in sorted(integers)}
    made["detail.tables"] = _random_tables(random)
    made["detail.basis"] = _random_basis(random)
    return serialise_weights(made, {"prior": [LATENT_CHANNELS, HYPER_CHANNELS, WIDTH]})


def empty_prior() -> LatentPrior:
    return LatentPrior(LATENT_CHANNELS, HYPER_CHANNELS, WIDTH)


def load_prior(weights: bytes, prior: LatentPrior) -> LatentPrior:
    """Return the entropy model with the integers of a weights file."""
    found = {name.removeprefix("prior."): value for name, value in load(weights).items() if name.startswith("prior.")}
    load_integers(prior, found)
    return prior.requires_grad_(False)


@cache
def tiny_prior() -> LatentPrior:
    return load_prior(TINY_MODEL.read_bytes(), empty_prior())


@cache
def tiny_model_id() -> bytes:
    return model_id_of(TINY_MODEL.read_bytes())


def random_like(name: str, like: Tensor, random: Random) -> Tensor:
    """Draw sums of four uniform values, an approximate Gaussian that is the same in every Python version."""
    is_output = "leave" in name or "hyper_prior" in name
    if name.endswith("weight"):
        spread, limit = 4096 * (3.0 if is_output else 1.4) / math.sqrt(like.shape[1]), (1 << 15) - 1
    else:
        spread, limit = 0.3 * 2**20, 1 << 24
    drawn = (math.sqrt(3.0) * (sum(random.random() for _ in range(4)) - 2.0) for _ in range(like.numel()))
    values = [max(-limit, min(limit, round(spread * value))) for value in drawn]
    return torch.tensor(values, dtype=like.dtype).view(like.shape)


def _random_tables(random: Random) -> Tensor:
    """Draw tables of detail: most of 8 to 30, one of six not coded (below 6), one of twelve any."""

    def draw() -> int:
        kind, value = int(12 * random.random()), random.random()
        if kind < 2:
            return int(6 * value)
        return int(64 * value) if kind == 2 else 8 + int(23 * value)

    tables = [[draw() for _ in range(NUM_BUCKETS)] for _ in range(DETAIL_PLANES)]
    return torch.tensor(tables, dtype=torch.uint8)


def _random_basis(random: Random) -> Tensor:
    """Draw multiples of 2^-12 below 1/32 in magnitude, which fp16 holds exactly."""
    size = PER_BLOCK**2 * sum(RAW.values())
    values = [[int(256 * random.random()) - 128 for _ in range(size)] for _ in range(DETAIL_PLANES)]
    return torch.tensor(values, dtype=torch.float32) / 4096


if __name__ == "__main__":
    TINY_MODEL.write_bytes(make_tiny_model())
