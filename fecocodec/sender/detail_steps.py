"""Find the detail layer of a scene: descend on its numbers while everything that is coded before stays as it is.

A step is several times cheaper than a step on latents, because no network runs: the numbers change the raw outputs of
the predictor's head directly (`DetailBasis`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int32, UInt8
from torch import Tensor

from fecocodec.coding.detail import Choose, encode_detail, step_size
from fecocodec.coding.symbol_choice import choose_symbols
from fecocodec.container import Detail
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.grid import LATENTS
from fecocodec.progress import Progress
from fecocodec.sender.distortion import LogDistortion
from fecocodec.sender.lambda_roles import detail_step, is_taught, price_of_detail
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.references import Pictures, References
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Stage

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

    references: photographs. gaussians: of these values, as the descent renders them. as_decoded: those of a decoder.
    price: of a bit, in units of D.
    """

    references: References
    gaussians: Callable[[Values], Gaussians]
    as_decoded: Callable[[Values], Gaussians]
    price: float

    @torch.no_grad()
    def distortion_of_file(self, values: Values) -> Float[Tensor, ""]:
        """Return D of what is decoded."""
        return self.references.distortion(self.as_decoded(values), distortion)[0]


def distortion(renderings: Pictures, photographs: Pictures) -> Float[Tensor, " picture"]:
    """Return D of each picture, without its part for structure."""
    squared = (renderings - photographs).square().mean(dim=(-3, -2, -1))
    return LogDistortion.log_weight * torch.log(squared + LogDistortion.least_error)


def find_detail(
    encoder: SceneEncoder, last: Stage[Any], lambda_q: int, config: OptimisationConfig, progress: Progress
) -> Detail | None:
    """Return the detail layer of one scene; None if it gains less than its bits cost.

    last: the last stage, as coded. lambda_q: that the user chose. config: with one step of the detail layer or more.
    Raises ModelError if the model has no detail layer.
    """
    search = search_of(encoder, last, lambda_q)
    values = values_of(encoder, search, lambda_q, config, progress)
    if not bool(values.isfinite().all()):
        return None
    tables = encoder.codec.receiver.detail_basis.tables.cpu().numpy()
    payload, symbols = encode_detail(tables, symbols_of(values), (len(values), values.shape[2], values.shape[3]))
    coded = torch.from_numpy(symbols).transpose(0, 1).to(values)
    gain = float(search.distortion_of_file(torch.zeros_like(values)) - search.distortion_of_file(coded))
    return Detail(detail_step(lambda_q), payload) if gain > search.price * 8 * len(payload) else None


def values_of(
    encoder: SceneEncoder,
    search: Search,
    lambda_q: int,
    config: OptimisationConfig,
    progress: Progress = Progress(),  # noqa: B008 - frozen
) -> Values:
    """Return the numbers before the choice of symbols. search: `search_of` the same scene."""
    height, width = (side // LATENTS for side in encoder.size)
    planes = len(encoder.codec.receiver.detail_basis.basis)
    start = torch.zeros(encoder.num_views, planes, height, width, device=encoder.images.device)
    return descend(search, start, config.detail_steps_of(encoder.num_views, encoder.num_pixels, lambda_q), progress)


def symbols_of(values: Values) -> Choose:
    """Return the function that chooses the symbols of each plane, given their tables."""
    planes = values.transpose(0, 1).double().cpu()
    price = torch.tensor(PRICE_OF_CHOICE, dtype=torch.float64)

    def choose(plane: int, table_index: UInt8[np.ndarray, "view h8 w8"]) -> Int32[np.ndarray, "view h8 w8"]:
        chosen = choose_symbols(planes[plane], torch.from_numpy(table_index).double(), price)
        found: np.ndarray = chosen.to(torch.int32).numpy()
        return found

    return choose


def descend(
    search: Search,
    start: Values,
    num_steps: int,
    progress: Progress = Progress(),  # noqa: B008 - frozen
) -> Values:
    """Return the numbers after `num_steps` steps of descent on D + price * R from `start`."""
    values, mean, square, of_plane = start, torch.zeros_like(start), torch.zeros(()), torch.zeros(())
    threshold = search.price * BITS_OF_ONE
    for number in range(num_steps):
        progress("finding detail", number / num_steps)
        gradient = _gradient(search, values, number)
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
def _gradient(search: Search, values: Values, number: int) -> Values:
    """Return the gradient of D. number: of the step."""
    values = values.detach().requires_grad_()
    of_scene, _ = search.references.taught(number).distortion(search.gaussians(values), distortion)
    (gradient,) = torch.autograd.grad(of_scene, values)
    return gradient


def search_of(encoder: SceneEncoder, last: Stage[Any], lambda_q: int) -> Search:
    """Return the search of one scene. Arguments as for `find_detail`.

    Colours are constant in the descent unless guides judge it: colours by direction would compensate depth errors.
    """
    predictor, basis = encoder.codec.receiver.predictor, encoder.codec.receiver.detail_basis
    inputs = predictor.before_head(last.state, encoder.cameras, last.inputs.condition)
    step = float(step_size(detail_step(lambda_q)))

    def gaussians(values: Values, has_fitted_colours: bool) -> Gaussians:
        prediction = predictor.at_head(*inputs, encoder.cameras, basis(values * step))
        return encoder.emit(prediction, last.fading, has_fitted_colours=has_fitted_colours)

    references = References.of(encoder)
    counts = references.num_context, references.num_guides
    of_descent = partial(gaussians, has_fitted_colours=is_taught(*counts))
    price = price_of_detail(*counts, lambda_q) / encoder.num_pixels
    return Search(references, of_descent, partial(gaussians, has_fitted_colours=True), price)
