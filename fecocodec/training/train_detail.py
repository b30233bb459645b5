"""Fit the detail layer of a finished model: its basis and the frequency tables of its symbols.

The basis holds principal components. On each training scene, descent changes the raw outputs of the predictor's head,
all of them freely, so that the context views are shown better. The components are those of these changes in blocks of
8x8 pixels, each raw output divided by how strongly the pictures depend on it.
"""

import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.captures.evaluation_index import read_index
from fecocodec.captures.scene_folder import read_views
from fecocodec.coding.detail import Choose, Size, buckets, encode_detail
from fecocodec.coding.symbol_choice import symbol_bits
from fecocodec.container import quantise_lambda
from fecocodec.entropy.tables import FIRST_CODED_TABLE, NUM_TABLES
from fecocodec.errors import InputError
from fecocodec.grid import PER_BLOCK
from fecocodec.receiver.model import NUM_BUCKETS, Receiver
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.detail_steps import search_of, symbols_of, values_of
from fecocodec.sender.distortion import LogDistortion
from fecocodec.sender.encode import write_stages
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Stage
from fecocodec.splatting.attributes import RAW
from fecocodec.splatting.emission import Prediction

SIZE = (256, 256)
LAMBDA_OF_LATENTS = 1e-3
LAMBDAS_OF_DETAIL = (5e-4, 3e-4, 1e-4, 3e-5, 1e-5)  # from 1e-3 on pairs have no detail
NUM_STEPS, MOMENTUM = 30, 0.7
FIRST_RMS = 0.0036  # of the first step, relative to the sensitivities
SMOOTHING = 3  # planes on each side whose counts a plane's tables also use, each half as much as the one nearer
UNCODED = 60.0  # bits that a symbol other than 0 counts as if its table codes nothing, so that it is lost
LAST_MAGNITUDE = 8  # of symbols that are counted apart
ROUNDS = 3  # of symbols chosen with the tables, and tables fitted to the symbols

Raw = Float[Tensor, "view raw h2 w2"]
Coded = tuple[SceneEncoder, Stage[Any]]


def fit_detail(codec: Codec, coded: list[Coded], planes: int) -> Receiver:
    """Return the codec's receiver with a new detail layer, fitted to these scenes."""
    receiver = with_detail(codec.receiver, basis_of(coded, planes))
    fit_tables(receiver, [(replaced(encoder, receiver), last) for encoder, last in coded])
    return receiver


@torch.no_grad()
def coded_scenes(codec: Codec, root: Path, index: Path, count: int) -> Iterator[Coded]:
    """Yield pairs of context views with their last stage, as coded at LAMBDA_OF_LATENTS.

    Raises InputError if the codec has the paper's method, or the index names no pair.
    """
    if not codec.receiver.config.kind.has_steps:
        raise InputError("This model has the paper's method, which codes no detail; choose a model of another method.")
    entries = [entry for entry in read_index(index) if len(entry.context) == 2]
    if not entries:
        raise InputError(f"{index}: no entry has two context views; give an index of pairs.")
    random.Random(0).shuffle(entries)
    for entry in entries[:count]:
        views = read_views(root / entry.scene, views=entry.context, size=SIZE, background="white")
        scene = prepare_scene(views, codec.device)
        encoder = SceneEncoder.of(codec, scene)
        yield encoder, write_stages(encoder, quantise_lambda(LAMBDA_OF_LATENTS), 2, DEFAULT)[-1]


def with_detail(receiver: Receiver, basis: Float[Tensor, "plane block"]) -> Receiver:
    """Return a receiver with this basis, as a weights file holds it, and tables for wide distributions."""
    found = Receiver(replace(receiver.config, detail_planes=len(basis)))
    kept = {name: value for name, value in receiver.state_dict().items() if not name.startswith("detail.")}
    detail = {f"detail.{name}": value for name, value in found.detail_basis.state_dict().items()}
    found.load_state_dict(kept | detail | {"detail.basis": basis.half().float()})
    return found.eval().requires_grad_(False)


def replaced(encoder: SceneEncoder, receiver: Receiver) -> SceneEncoder:
    """Return the encoder of the same scene with another receiver."""
    return SceneEncoder(replace(encoder.codec, receiver=receiver), encoder.images, encoder.cameras, encoder.cut_out)


def basis_of(coded: list[Coded], planes: int) -> Float[Tensor, "plane block"]:
    """Return the principal components of the changes that descent finds, in order of their variance."""
    sensitivity = torch.stack([_slope(*of, None).square().mean(dim=(0, 2, 3)) for of in coded]).mean(dim=0).sqrt()
    covariance = torch.zeros((PER_BLOCK**2 * len(sensitivity),) * 2, dtype=torch.float64)
    for encoder, last in coded:
        change = _free_change(encoder, last, sensitivity) * sensitivity[:, None, None]
        blocks = rearrange(change, "v c (h p) (w q) -> (v h w) (p q c)", p=PER_BLOCK, q=PER_BLOCK).double()
        covariance += blocks.T @ blocks
    _, vectors = torch.linalg.eigh(covariance)
    components = vectors.flip(1)[:, :planes].T.float()
    return components / sensitivity.repeat(PER_BLOCK**2)


def _free_change(encoder: SceneEncoder, last: Stage[Any], sensitivity: Float[Tensor, " raw"]) -> Raw:
    """Return the changes of the raw outputs after NUM_STEPS steps; steps are longer where sensitivity is small."""
    change, mean = torch.zeros(()), torch.zeros(())
    length = None
    for number in range(NUM_STEPS):
        direction = _slope(encoder, last, change if number else None) / sensitivity.square()[:, None, None]
        if length is None:
            relative = (direction * sensitivity[:, None, None]).square().mean().sqrt()
            length = FIRST_RMS * sensitivity.mean() / relative
        mean = MOMENTUM * mean + direction
        change = change - length * (1.0 if number < 2 * NUM_STEPS // 3 else 0.5) * mean
    return change


@torch.enable_grad()
def _slope(encoder: SceneEncoder, last: Stage[Any], change: Raw | None) -> Raw:
    """Return the gradient of the distortion with respect to the raw outputs, times the Gaussians of a view."""
    predictor, cameras = encoder.codec.receiver.predictor, encoder.cameras
    height, width = (side // 2 for side in encoder.size)
    if change is None:
        change = torch.zeros(encoder.num_views, sum(RAW.values()), height, width)
    change = change.detach().requires_grad_()
    inputs = predictor.before_head(last.state, cameras, last.inputs.condition)
    prediction: Prediction = predictor.at_head(*inputs, cameras, change)
    gaussians = encoder.emit(prediction, has_fitted_colours=False)
    rendered = render(gaussians, cameras.scene(0), encoder.size).color
    squared = (rendered - encoder.images[0]).square().mean(dim=(-3, -2, -1))
    (gradient,) = torch.autograd.grad(torch.log(squared + LogDistortion.least_error).mean(), change)
    return gradient * height * width


def fit_tables(receiver: Receiver, coded: list[Coded]) -> None:
    """Set the tables of the receiver's detail layer to those that cost the training scenes the fewest bits."""
    detail = receiver.detail_basis
    found: list[tuple[Choose, Size]] = []
    with torch.no_grad():
        for encoder, last in coded:
            for lmbda in LAMBDAS_OF_DETAIL:
                lambda_q = quantise_lambda(lmbda)
                search = search_of(encoder, last, lambda_q)
                values = values_of(encoder, search, lambda_q, DEFAULT)
                found.append((symbols_of(values), (len(values), *values.shape[2:])))
    for _ in range(ROUNDS):
        counts = sum(_counts(detail.tables.numpy(), *scene) for scene in found)
        detail.tables.copy_(torch.from_numpy(best_tables(np.asarray(counts))))


def _counts(tables: np.ndarray, choose: Choose, size: Size) -> Int[np.ndarray, "plane 16 magnitude"]:
    """Return how often each magnitude, up to the last, occurs in each context with these tables."""
    _, symbols = encode_detail(tables, choose, size)
    counts = np.zeros((len(symbols), NUM_BUCKETS, LAST_MAGNITUDE + 1), np.int64)
    planes = np.arange(len(symbols))[:, None, None, None]
    np.add.at(counts, (planes, buckets(symbols), np.minimum(np.abs(symbols), LAST_MAGNITUDE)), 1)
    return counts


def best_tables(counts: Int[np.ndarray, "plane 16 magnitude"]) -> np.ndarray:
    """Return the table of each plane and context that costs these symbols the fewest bits."""
    smooth = counts.astype(float)
    for distance in range(1, SMOOTHING + 1):
        smooth[distance:] += 0.5**distance * counts[:-distance]
        smooth[:-distance] += 0.5**distance * counts[distance:]
    smooth += 0.02 * smooth.mean(axis=0, keepdims=True)
    magnitude = torch.arange(LAST_MAGNITUDE + 1.0)
    bits = torch.stack([symbol_bits(magnitude, torch.tensor(float(table))) for table in range(NUM_TABLES)]).numpy()
    bits[:FIRST_CODED_TABLE] = UNCODED
    bits[:FIRST_CODED_TABLE, 0] = 0.0
    found: np.ndarray = (smooth[..., None, :] * bits).sum(axis=-1).argmin(axis=-1).astype(np.uint8)
    return found
