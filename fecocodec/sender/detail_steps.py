"""Find the detail layer of a scene: descend on its numbers while everything that is coded before stays as it is.

A step is several times cheaper than a step on latents, because no network runs: the numbers change the raw outputs of
the predictor's head directly (`receiver/detail.py`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32, UInt8
from torch import Tensor

from fecocodec.coding.detail import BLOCK, Choose, encode_detail, step_size
from fecocodec.coding.symbol_choice import choose_symbols
from fecocodec.container import Detail
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.predictor import Prediction
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.cut_out import Pictures
from fecocodec.sender.distortion import LogDistortion
from fecocodec.sender.optimisation_config import OptimisationConfig, price_of_detail
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import OnFraction, Stage

Values = Float[Tensor, "view plane h8 w8"]  # in steps

# Adam with one scale for all planes of a block, times one for each plane, and a soft threshold for the rate.
LENGTH = 0.6  # of the first step
MOMENTUM, MEMORY = 0.6, 0.85  # of the mean and the square of the gradient
LEAST_SCALE = 0.2  # of a block's gradients, as a share of the mean over the blocks
PLANE_EXPONENT = 0.5  # of the scale of a plane
BITS_OF_ONE = 9.0  # bits that the threshold takes a symbol of magnitude 1 for
PRICE_OF_CHOICE = 0.12  # of a bit, in squared steps, for the choice of symbols


@dataclass(frozen=True)
class Search:
    """What a search of one scene needs.

    images: photographs; of cut-outs on white, then on black. rendered: pictures of the views, like the photographs,
    with constant colours. as_decoded: the same with those of a decoder. price: of a bit, in units of D.
    """

    images: Pictures
    rendered: Callable[[Values], Pictures]
    as_decoded: Callable[[Values], Pictures]
    price: float

    def distortion(self, rendered: Pictures) -> Float[Tensor, ""]:
        """Return D, without its part for structure."""
        squared = (rendered - self.images).square().mean(dim=(-3, -2, -1))
        return LogDistortion.log_weight * torch.log(squared + LogDistortion.least_error).mean()

    @torch.no_grad()
    def distortion_of_file(self, values: Values) -> Float[Tensor, ""]:
        """Return D of what is decoded."""
        return self.distortion(self.as_decoded(values))


def find_detail(
    encoder: SceneEncoder,
    last: Stage[Any],
    visibility: Float32[np.ndarray, " n"] | None,
    lambda_q: int,
    config: OptimisationConfig,
    on_fraction: OnFraction = lambda _fraction: None,
) -> Detail | None:
    """Return the detail layer of one scene; None if it gains less than its bits cost.

    last: the last stage, as coded. visibility: factors of opacities, as the decoder applies them. lambda_q: that the
    user chose. config: with one step of the detail layer or more. Raises ModelError if the model has no detail layer.
    """
    search = search_of(encoder, last, visibility, lambda_q, config)
    values = values_of(encoder, search, lambda_q, config, on_fraction)
    if not bool(values.isfinite().all()):
        return None
    tables = encoder.codec.receiver.detail_basis.tables.cpu().numpy()
    payload, symbols = encode_detail(tables, symbols_of(values), (len(values), values.shape[2], values.shape[3]))
    coded = torch.from_numpy(symbols).transpose(0, 1).to(values)
    gain = float(search.distortion_of_file(torch.zeros_like(values)) - search.distortion_of_file(coded))
    return Detail(config.detail_step_of(lambda_q), payload) if gain > search.price * 8 * len(payload) else None


def values_of(
    encoder: SceneEncoder,
    search: Search,
    lambda_q: int,
    config: OptimisationConfig,
    on_fraction: OnFraction = lambda _fraction: None,
) -> Values:
    """Return the numbers before the choice of symbols. search: `search_of` the same scene."""
    height, width = (side // BLOCK for side in encoder.size)
    planes = len(encoder.codec.receiver.detail_basis.basis)
    start = torch.zeros(encoder.num_views, planes, height, width, device=encoder.images.device)
    return descend(search, start, config.detail_steps_of(encoder.num_views, encoder.num_pixels, lambda_q), on_fraction)


def symbols_of(values: Values) -> Choose:
    """Return the function that chooses the symbols of each plane, given their tables."""
    planes = values.transpose(0, 1).double().cpu()
    price = torch.tensor(PRICE_OF_CHOICE, dtype=torch.float64)

    def choose(plane: int, table_index: UInt8[np.ndarray, "view h8 w8"]) -> Int32[np.ndarray, "view h8 w8"]:
        chosen = choose_symbols(planes[plane], torch.from_numpy(table_index).double(), price)
        found: np.ndarray = chosen.to(torch.int32).numpy()
        return found

    return choose


def descend(search: Search, start: Values, num_steps: int, on_fraction: OnFraction = lambda _fraction: None) -> Values:
    """Return the numbers after `num_steps` steps of descent on D + price * R from `start`."""
    values, mean, square, of_plane = start, torch.zeros_like(start), torch.zeros(()), torch.zeros(())
    threshold = search.price * BITS_OF_ONE
    for number in range(num_steps):
        on_fraction(number / num_steps)
        gradient = _gradient(search, values)
        age = number + 1
        mean = MOMENTUM * mean + (1.0 - MOMENTUM) * gradient
        square = MEMORY * square + (1.0 - MEMORY) * gradient.square().mean(dim=1, keepdim=True)
        of_plane = MEMORY * of_plane + (1.0 - MEMORY) * gradient.square().mean(dim=(0, 2, 3), keepdim=True)
        of_block, scale = ((x / (1.0 - MEMORY**age)).sqrt() for x in (square, of_plane))
        scale = (scale / scale.mean().clamp(min=1e-20)).clamp(min=0.05) ** PLANE_EXPONENT
        left = 1.0 - number / (num_steps + 1)
        length = LENGTH * left / ((of_block + LEAST_SCALE * of_block.mean()).clamp(min=1e-20) * scale)
        values = values - length * mean / (1.0 - MOMENTUM**age)
        values = values.sign() * (values.abs() - length * threshold).clamp(min=0.0)
    return values


@torch.enable_grad()
def _gradient(search: Search, values: Values) -> Values:
    """Return the gradient of D."""
    values = values.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(search.distortion(search.rendered(values)), values)
    return gradient


def search_of(
    encoder: SceneEncoder,
    last: Stage[Any],
    visibility: Float32[np.ndarray, " n"] | None,
    lambda_q: int,
    config: OptimisationConfig,
) -> Search:
    """Return the search of one scene. Arguments as for `find_detail`.

    Colours are constant in the descent: view-dependent ones would compensate depth errors.
    """
    predictor, basis = encoder.codec.receiver.predictor, encoder.codec.receiver.detail_basis
    cameras = encoder.cameras
    inputs = predictor.before_head(last.state, cameras, last.inputs.condition)
    factors = None if visibility is None else torch.from_numpy(visibility).to(encoder.images)
    step = float(step_size(config.detail_step_of(lambda_q)))

    def predicted(values: Values) -> Prediction:
        return predictor.gaussians(*inputs, cameras, basis(values * step))

    def pictures(gaussians: Gaussians, prediction: Prediction) -> Pictures:
        if factors is not None:
            gaussians = replace(gaussians, opacities=gaussians.opacities * factors)
        gaussians = encoder.completed(gaussians, prediction)
        return encoder.pictures(render(gaussians, cameras.scene(0), encoder.size))

    def rendered(values: Values) -> Pictures:
        prediction = predicted(values)
        return pictures(prediction.gaussians.scene(0), prediction)

    def as_decoded(values: Values) -> Pictures:
        prediction = predicted(values)
        return pictures(encoder.gaussians(prediction), prediction)

    return Search(
        encoder.photographs,
        rendered,
        as_decoded,
        price_of_detail(config, encoder.num_views, lambda_q) / encoder.num_pixels,
    )
